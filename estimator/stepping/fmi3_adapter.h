/* fmi3_adapter: FMI 3.0 co-simulation, in the shape of the FMI 2.0 functions that the stepper calls.
 *
 * Knows the two standards, nothing of candidates. The stepper's `callbacks` carries the FMU's functions; a component
 * is an Adapted. One indirect call a function: 1 to 2 ns. Real means Float64.
 */
#ifndef FMI3_ADAPTER_H
#define FMI3_ADAPTER_H

#include <stdint.h>
#include <stdlib.h>

#include "fmi2Functions.h"
#include "fmi3Functions.h"

/* A value that is set once, before initialisation, and is no real number. */
enum { WHOLE = 0, TRUTH, TEXT, FLOAT32, INT8, UINT8, INT16, UINT16, INT32, UINT32, INT64, UINT64 };

typedef struct {
    int64_t type;
    int64_t reference;
    int64_t whole;
    double real;
    const char *text;
} Setting;

typedef void Function(void);

/* The FMU's functions. `set_other` is in the order of the types above, from TRUTH on; NULL where it is missing. */
typedef struct {
    fmi3InstantiateCoSimulationTYPE *instantiate;
    fmi3FreeInstanceTYPE *free_instance;
    fmi3ResetTYPE *reset;
    fmi3EnterInitializationModeTYPE *enter_initialization;
    fmi3ExitInitializationModeTYPE *exit_initialization;
    fmi3SetFloat64TYPE *set_float64;
    fmi3GetFloat64TYPE *get_float64;
    fmi3DoStepTYPE *do_step;
    Function *set_other[UINT64 + 1];
    void *log;               /* the stepper's Log */
    fmi3LogMessageCallback log_message;
} Fmi3;

typedef struct {
    const Fmi3 *fmi;
    fmi3Instance instance;
    double start;
    double stop;
    bool stops;
} Adapted;

static fmi2Component adapted_instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                                         const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                         fmi2Boolean logging) {
    const Fmi3 *fmi = (const Fmi3 *)(const void *)callbacks;
    Adapted *adapted = calloc(1, sizeof *adapted);
    (void)type;
    if (adapted == NULL) return NULL;
    adapted->fmi = fmi;
    adapted->instance = fmi->instantiate(name, token, resources, visible != 0, logging != 0, false, false, NULL, 0,
                                         fmi->log, fmi->log_message, NULL);
    if (adapted->instance != NULL) return adapted;
    free(adapted);
    return NULL;
}

static void adapted_free(fmi2Component component) {
    Adapted *adapted = component;
    adapted->fmi->free_instance(adapted->instance);
    free(adapted);
}

static fmi2Status adapted_reset(fmi2Component component) {
    Adapted *adapted = component;
    return (fmi2Status)adapted->fmi->reset(adapted->instance);
}

static fmi2Status adapted_setup(fmi2Component component, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                                fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop) {
    Adapted *adapted = component;
    (void)tolerance_defined, (void)tolerance;
    adapted->start = start;
    adapted->stop = stop;
    adapted->stops = stop_defined != 0;
    return fmi2OK;
}

static fmi2Status adapted_enter(fmi2Component component) {
    Adapted *adapted = component;
    return (fmi2Status)adapted->fmi->enter_initialization(adapted->instance, false, 0.0, adapted->start, adapted->stops,
                                                         adapted->stop);
}

static fmi2Status adapted_exit(fmi2Component component) {
    Adapted *adapted = component;
    return (fmi2Status)adapted->fmi->exit_initialization(adapted->instance);
}

static fmi2Status adapted_set(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Real values[]) {
    Adapted *adapted = component;
    return (fmi2Status)adapted->fmi->set_float64(adapted->instance, references, count, values, count);
}

static fmi2Status adapted_get(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Real values[]) {
    Adapted *adapted = component;
    return (fmi2Status)adapted->fmi->get_float64(adapted->instance, references, count, values, count);
}

static fmi2Status adapted_step(fmi2Component component, fmi2Real time, fmi2Real h, fmi2Boolean no_set_state) {
    Adapted *adapted = component;
    bool event = false, terminate = false, early = false;
    double reached = time + h;
    fmi3Status status = adapted->fmi->do_step(adapted->instance, time, h, no_set_state != 0, &event, &terminate,
                                              &early, &reached);
    return terminate && status <= fmi3Warning ? fmi2Discard : (fmi2Status)status;
}

#define SET_AS(TYPE, FUNCTION, VALUE)                                                                      \
    {                                                                                                      \
        const TYPE value = (TYPE)(VALUE);                                                                  \
        return (fmi2Status)((FUNCTION *)function)(instance, &reference, 1, &value, 1);                     \
    }

static fmi2Status set_other_3(Function *function, fmi3Instance instance, const Setting *setting) {
    const fmi3ValueReference reference = (fmi3ValueReference)setting->reference;
    switch (setting->type) {
    case TRUTH: SET_AS(fmi3Boolean, fmi3SetBooleanTYPE, setting->whole != 0)
    case TEXT: SET_AS(fmi3String, fmi3SetStringTYPE, setting->text)
    case FLOAT32: SET_AS(fmi3Float32, fmi3SetFloat32TYPE, setting->real)
    case INT8: SET_AS(fmi3Int8, fmi3SetInt8TYPE, setting->whole)
    case UINT8: SET_AS(fmi3UInt8, fmi3SetUInt8TYPE, setting->whole)
    case INT16: SET_AS(fmi3Int16, fmi3SetInt16TYPE, setting->whole)
    case UINT16: SET_AS(fmi3UInt16, fmi3SetUInt16TYPE, setting->whole)
    case INT32: SET_AS(fmi3Int32, fmi3SetInt32TYPE, setting->whole)
    case UINT32: SET_AS(fmi3UInt32, fmi3SetUInt32TYPE, setting->whole)
    case INT64: SET_AS(fmi3Int64, fmi3SetInt64TYPE, setting->whole)
    default: SET_AS(fmi3UInt64, fmi3SetUInt64TYPE, setting->whole)
    }
}

static fmi2Status adapted_set_other(fmi2Component component, const Setting *setting) {
    Adapted *adapted = component;
    Function *function = NULL;
    if (setting->type > WHOLE && setting->type <= UINT64) function = adapted->fmi->set_other[setting->type];
    return function == NULL ? fmi2Error : set_other_3(function, adapted->instance, setting);
}

#endif
