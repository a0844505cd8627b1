/* The functions of FMI 2.0, written once for every model. Co-simulation and model exchange; those that are not offered
 * exist, log and return fmi2Error. Knows no model.
 *
 * Allocates with the C library. Messages are complete text, without format directives. Pointers given to
 * fmi2Instantiate are copied.
 */
#include "instance.c"

#include "fmi2Functions.h"

typedef struct {
    Instance instance; /* first: a pointer to it is one to this */
    char *name;
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
} Component;

typedef fmi2Status FmiStatus;
typedef fmi2Component FmiInstance;
typedef fmi2String FmiString;
typedef fmi2Boolean FmiBoolean;
typedef fmi2Byte FmiByte;
#define FMI_NAME(name) fmi2##name
#define FMI_STATE(before, after) fmi2##before##FMUstate##after
#define FMI_READ_STATE fmi2DeSerializeFMUstate
#define FMI_GET_DERIVATIVES fmi2GetDerivatives
#include "fmi.c"

static void fmi2_log(const Instance *instance, Status status, const char *message)
{
    const Component *component = (const Component *)instance;
    component->logger(component->environment, component->name, (fmi2Status)status,
                  log_categories[status == INSTANCE_DISCARD ? LOG_DISCARD : LOG_ERROR].name, message);
}

/* ---- Inquiry, creation, logging ---- */

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    const char *name = instanceName != NULL ? instanceName : "";
    Component *component = calloc(1, sizeof *component);
    (void)fmuResourceLocation;
    (void)visible;
    if (component == NULL) return NULL;
    component->name = malloc(strlen(name) + 1);
    if (component->name == NULL) {
        free(component);
        return NULL;
    }
    strcpy(component->name, name);
    if (functions != NULL && functions->logger != NULL) {
        component->logger = functions->logger;
        component->environment = functions->componentEnvironment;
        component->instance.log = fmi2_log;
    }
    component->instance.log_discard = component->instance.log_error = loggingOn != fmi2False;
    component->instance.model_exchange = fmuType == fmi2ModelExchange;
    instance_reset(&component->instance);
    if (fmuGUID == NULL || strcmp(fmuGUID, MODEL_GUID) != 0) {
        (void)instance_report(&component->instance, INSTANCE_ERROR,
                              "wrong GUID: this binary and that modelDescription.xml do not belong together");
    } else {
        return component;
    }
    fmi2FreeInstance(component);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c)
{
    Component *component = c;
    if (component == NULL) return;
    free(component->name);
    free(component);
}

/* ---- Phases ---- */

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    (void)toleranceDefined; /* the integrator is exact, or has its own, tight one */
    (void)tolerance;
    if (c == NULL) return fmi2Error;
    return (fmi2Status)instance_set_up(c, startTime, stopTimeDefined != fmi2False, stopTime);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    if (c == NULL) return fmi2Error;
    return (fmi2Status)instance_enter(c, PHASE_INSTANTIATED, PHASE_INITIALIZATION, "entering initialisation");
}

/* ---- Values ---- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    if (c == NULL) return fmi2Error;
    return (fmi2Status)instance_get(c, N_VARIABLES, vr, nvr, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    if (c == NULL) return fmi2Error;
    return (fmi2Status)instance_set(c, vr, nvr, value);
}

/* All variables are real. */
#define NO_SUCH_VARIABLES(function, type)                                                           \
    fmi2Status function(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, type value[])   \
    {                                                                                               \
        (void)vr;                                                                                   \
        (void)value;                                                                                \
        return c != NULL && nvr == 0 ? fmi2OK : fmi_not_offered(c, #function);                     \
    }
NO_SUCH_VARIABLES(fmi2GetInteger, fmi2Integer)
NO_SUCH_VARIABLES(fmi2GetBoolean, fmi2Boolean)
NO_SUCH_VARIABLES(fmi2GetString, fmi2String)
NO_SUCH_VARIABLES(fmi2SetInteger, const fmi2Integer)
NO_SUCH_VARIABLES(fmi2SetBoolean, const fmi2Boolean)
NO_SUCH_VARIABLES(fmi2SetString, const fmi2String)

/* ---- Co-simulation ---- */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    (void)noSetFMUStatePriorToCurrentPoint; /* every state can be restored */
    if (c == NULL) return fmi2Error;
    return (fmi2Status)instance_step(c, currentCommunicationPoint, communicationStepSize);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    if (c == NULL || value == NULL || s != fmi2LastSuccessfulTime) return fmi_not_offered(c, "this real status");
    *value = *instance_time(c);
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    if (c == NULL || value == NULL || s != fmi2Terminated) return fmi_not_offered(c, "this boolean status");
    *value = fmi2False; /* never asks for the end of the simulation */
    return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return c != NULL && nvr == 0 ? fmi2OK : fmi_not_offered(c, "fmi2SetRealInputDerivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return c != NULL && nvr == 0 ? fmi2OK : fmi_not_offered(c, "fmi2GetRealOutputDerivatives");
}

/* ---- Directional derivatives ---- */

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown,
                                        const fmi2Real dvKnown[], fmi2Real dvUnknown[])
{
    if (c == NULL) return fmi2Error;
    return (fmi2Status)instance_differentiate(c, vUnknown_ref, nUnknown, vKnown_ref, nKnown, dvKnown, dvUnknown);
}

/* ---- Model exchange: events are changes of mode, and those in which the importer changes a parameter ---- */

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *fmi2eventInfo)
{
    bool changed;
    Status status;
    if (c == NULL) return fmi2Error;
    if (!instance_exchanges(c, PHASE_EVENT, PHASE_EVENT))
        return (fmi2Status)instance_refuse(c, "updating discrete states");
    if (fmi2eventInfo == NULL) return fmi2Error;
    status = instance_settle(c, &changed);
    memset(fmi2eventInfo, 0, sizeof *fmi2eventInfo); /* no, to all else */
    fmi2eventInfo->valuesOfContinuousStatesChanged = changed;
    return (fmi2Status)status;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    if (c == NULL) return fmi2Error;
    if (!instance_exchanges(c, PHASE_CONTINUOUS, PHASE_CONTINUOUS))
        return (fmi2Status)instance_refuse(c, "completing an integrator step");
    if (enterEventMode == NULL || terminateSimulation == NULL) return fmi2Error;
    *enterEventMode = *terminateSimulation = fmi2False;
    return fmi2OK;
}

/* ---- Not offered: steps are never pending ---- */

#define NOT_OFFERED(function)               \
    fmi2Status function(fmi2Component c)    \
    {                                       \
        return fmi_not_offered(c, #function); \
    }
#define NOT_OFFERED_2(function, type_a, type_b)              \
    fmi2Status function(fmi2Component c, type_a a, type_b b) \
    {                                                        \
        (void)a;                                             \
        (void)b;                                             \
        return fmi_not_offered(c, #function);               \
    }

NOT_OFFERED(fmi2CancelStep)
NOT_OFFERED_2(fmi2GetStatus, const fmi2StatusKind, fmi2Status *)
NOT_OFFERED_2(fmi2GetIntegerStatus, const fmi2StatusKind, fmi2Integer *)
NOT_OFFERED_2(fmi2GetStringStatus, const fmi2StatusKind, fmi2String *)
