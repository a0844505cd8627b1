/* equations: what an FMU for model exchange calculates, the same in FMI 1.0, 2.0 and 3.0. Knows no solver.
 *
 * Every call returns an FMI status; the first two values, OK and Warning, are success. The functions come as addresses
 * in the structure Equations, whose ctypes mirror is in structures.py; what an FMU lacks is NULL there.
 */
#ifndef EQUATIONS_H
#define EQUATIONS_H

#include <stddef.h>
#include <stdint.h>

#include "bdf.h"
#include "fmi2Functions.h"
#include "fmi3Functions.h"
#include "fmi3_adapter.h"

/* FMI 1.0, as its standard has it; booleans are characters. */
typedef struct {
    char converged, references_changed, values_changed, terminate, has_next;
    double next;
} Event1;
typedef struct {
    void *logger, *allocate, *release, *finished;
} Callbacks1;

/* One FMU's functions, and what holds for all its instances. */
typedef struct {
    int64_t version;          /* 1, 2 or 3 */
    int64_t is_model;         /* model exchange; 0: co-simulation of FMI 1.0 */
    int64_t states, indicators; /* of FMI 1.0 and 2.0; FMI 3.0 is asked */
    double tolerance;         /* relative; the absolute one is that times the states' nominal values */
    double horizon;           /* s, until when the inputs stay as they are; whoever sets inputs may say so */
    Function *instantiate, *free_instance, *reset, *setup, *enter, *exit, *initialize;
    Function *set_real, *get_real, *do_step;
    Function *set_time, *set_states, *get_states, *get_derivatives, *get_indicators, *get_nominals;
    Function *enter_event, *update, *enter_continuous, *completed, *count_states, *count_indicators;
    Function *set_other[UINT64 + 1];
    const void *callbacks;    /* FMI 1.0: Callbacks1; 2.0: fmi2CallbackFunctions */
    void *log;                /* the stepper's Log, for FMI 3.0 */
    fmi3LogMessageCallback log_message;
    char *words;              /* of 512 characters: the last message, for those that the FMU does not give */
    const char *location;     /* FMI 1.0 co-simulation: where the FMU lies */
    Sundials sundials;
} Equations;

/* What an event leads to. */
typedef struct {
    int terminate;
    int has_next;
    double next; /* s */
} Event;

/* Functions of FMI 1.0, and those that all versions have alike. */
typedef int SetTime(void *, double);
typedef int GiveArray(void *, const double *, size_t);
typedef int TakeArray(void *, double *, size_t);
typedef int Simple(void *);
typedef int Completed1(void *, char *);
typedef int Update1(void *, char, Event1 *);
typedef void *InstantiateModel1(const char *, const char *, Callbacks1, char);
typedef void *InstantiateSlave1(const char *, const char *, const char *, const char *, double, char, char, Callbacks1,
                                char);
typedef int InitializeSlave1(void *, double, char, double);
typedef int Initialize1(void *, char, double, Event1 *);
typedef int SetReals(void *, const unsigned *, size_t, const double *);
typedef int GetReals(void *, const unsigned *, size_t, double *);
typedef int SetTexts(void *, const unsigned *, size_t, const char *const *);
typedef int SetTruths1(void *, const unsigned *, size_t, const char *);
typedef int SetWholes(void *, const unsigned *, size_t, const int *);
typedef void FreeInstance(void *);
typedef int DoStep1(void *, double, double, char);

#define CALL(TYPE, FUNCTION) ((TYPE *)(FUNCTION))

static int set_time(const Equations *e, void *c, double t) {
    return CALL(SetTime, e->set_time)(c, t);
}

static int set_states(const Equations *e, void *c, const double *x, size_t n) {
    return CALL(GiveArray, e->set_states)(c, x, n);
}

static int get_states(const Equations *e, void *c, double *x, size_t n) {
    return CALL(TakeArray, e->get_states)(c, x, n);
}

static int get_derivatives(const Equations *e, void *c, double *slope, size_t n) {
    return CALL(TakeArray, e->get_derivatives)(c, slope, n);
}

static int get_indicators(const Equations *e, void *c, double *z, size_t n) {
    return CALL(TakeArray, e->get_indicators)(c, z, n);
}

static int get_nominals(const Equations *e, void *c, double *x, size_t n) {
    return e->get_nominals == NULL ? 3 : CALL(TakeArray, e->get_nominals)(c, x, n);
}

/* FMI 2.0 and 3.0: enter event mode. */
static int enter_event(const Equations *e, void *c) {
    return e->version == 1 ? 0 : CALL(Simple, e->enter_event)(c);
}

static int enter_continuous(const Equations *e, void *c) {
    return e->version == 1 ? 0 : CALL(Simple, e->enter_continuous)(c);
}

/* An integrator step is complete: does the FMU want an event, does it end? */
static int completed(const Equations *e, void *c, int *wants, int *ends) {
    int status;
    *wants = *ends = 0;
    if (e->completed == NULL) return 0;
    if (e->version == 1) {
        char event = 0;
        status = CALL(Completed1, e->completed)(c, &event);
        *wants = event != 0;
    } else if (e->version == 2) {
        fmi2Boolean event = fmi2False, end = fmi2False;
        status = (int)CALL(fmi2CompletedIntegratorStepTYPE, e->completed)(c, fmi2True, &event, &end);
        *wants = event != fmi2False;
        *ends = end != fmi2False;
    } else {
        bool event = false, end = false;
        status = (int)CALL(fmi3CompletedIntegratorStepTYPE, e->completed)(c, true, &event, &end);
        *wants = event;
        *ends = end;
    }
    return status;
}

enum { EVENT_ITERATIONS = 100, NEVER_SETTLES = 256 };

/* Let the discrete states settle. NEVER_SETTLES: they do not. */
static int settle(const Equations *e, void *c, Event *event) {
    for (int k = 0; k < EVENT_ITERATIONS; k++) {
        int status, again;
        if (e->version == 1) {
            Event1 info = {0};
            status = CALL(Update1, e->update)(c, 0, &info);
            *event = (Event){info.terminate != 0, info.has_next != 0, info.next};
            again = 0; /* it is asked for the last iteration only */
        } else if (e->version == 2) {
            fmi2EventInfo info = {.newDiscreteStatesNeeded = fmi2False};
            status = (int)CALL(fmi2NewDiscreteStatesTYPE, e->update)(c, &info);
            *event = (Event){info.terminateSimulation != fmi2False, info.nextEventTimeDefined != fmi2False,
                             info.nextEventTime};
            again = info.newDiscreteStatesNeeded != fmi2False;
        } else {
            bool needed = false, end = false, nominals = false, values = false, has_next = false;
            double next = 0.0;
            status = (int)CALL(fmi3UpdateDiscreteStatesTYPE, e->update)(c, &needed, &end, &nominals, &values, &has_next,
                                                                       &next);
            *event = (Event){end, has_next, next};
            again = needed;
        }
        if (status > 1 || event->terminate || !again) return status;
    }
    return NEVER_SETTLES;
}

/* The life of an instance. */

static void *equations_instantiate(const Equations *e, const char *name, const char *guid, const char *resources,
                                   int logging) {
    if (e->version == 3)
        return CALL(fmi3InstantiateModelExchangeTYPE, e->instantiate)(name, guid, resources, false, logging != 0,
                                                                      e->log, e->log_message);
    if (e->version == 2)
        return CALL(fmi2InstantiateTYPE, e->instantiate)(name, fmi2ModelExchange, guid, resources, e->callbacks,
                                                         fmi2False, logging);
    if (e->is_model)
        return CALL(InstantiateModel1, e->instantiate)(
            name, guid, *(const Callbacks1 *)e->callbacks, (char)(logging != 0));
    return CALL(InstantiateSlave1,
                e->instantiate)(name, guid, e->location, "application/x-fmu-sharedlibrary", 0.0, 0, 0,
                                *(const Callbacks1 *)e->callbacks, (char)(logging != 0));
}

/* Begin the initialisation. */
static int equations_enter(const Equations *e, void *c, double start, int stops, double stop) {
    int status;
    if (e->version == 1) return e->is_model ? set_time(e, c, start) : 0;
    if (e->version == 3)
        return (int)CALL(fmi3EnterInitializationModeTYPE, e->enter)(c, false, 0.0, start, stops != 0, stop);
    status = (int)CALL(fmi2SetupExperimentTYPE, e->setup)(c, fmi2False, 0.0, start, stops, stop);
    return status > 1 ? status : (int)CALL(fmi2EnterInitializationModeTYPE, e->enter)(c);
}

/* End the initialisation; an FMU for model exchange is ready for continuous time then. */
static int equations_exit(const Equations *e, void *c, double start, int stops, double stop, Event *event) {
    int status;
    *event = (Event){0};
    if (e->version == 1 && !e->is_model)
        return CALL(InitializeSlave1, e->initialize)(c, start, (char)(stops != 0), stop);
    if (e->version == 1) {
        Event1 info = {0};
        status = CALL(Initialize1, e->initialize)(c, 0, 0.0, &info);
        *event = (Event){info.terminate != 0, info.has_next != 0, info.next};
        return status;
    }
    status = CALL(Simple, e->exit)(c);
    if (status <= 1) status = settle(e, c, event);
    return status > 1 || event->terminate ? status : enter_continuous(e, c);
}

static int set_reals(const Equations *e, void *c, const unsigned references[], size_t n, const double values[]) {
    if (e->version == 3) return (int)CALL(fmi3SetFloat64TYPE, e->set_real)(c, references, n, values, n);
    return CALL(SetReals, e->set_real)(c, references, n, values);
}

static int get_reals(const Equations *e, void *c, const unsigned references[], size_t n, double values[]) {
    if (e->version == 3) return (int)CALL(fmi3GetFloat64TYPE, e->get_real)(c, references, n, values, n);
    return CALL(GetReals, e->get_real)(c, references, n, values);
}

static int set_value(const Equations *e, void *c, const Setting *setting) {
    const unsigned reference = (unsigned)setting->reference;
    Function *function = setting->type >= WHOLE && setting->type <= UINT64 ? e->set_other[setting->type] : NULL;
    if (function == NULL) return 3;
    if (e->version == 3) return (int)set_other_3(function, c, setting);
    if (setting->type == TEXT)
        return CALL(SetTexts, function)(c, &reference, 1,
                                                                                         &setting->text);
    if (setting->type == TRUTH && e->version == 1) {
        const char truth = (char)(setting->whole != 0);
        return CALL(SetTruths1, function)(c, &reference, 1, &truth);
    }
    const int whole = (int)setting->whole;
    return CALL(SetWholes, function)(c, &reference, 1, &whole);
}

#endif
