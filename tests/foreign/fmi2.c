/* motor.h as FMI 2.0, co-simulation and model exchange. */
#include "motor.h"
#include "fmi2Functions.h"

#define M ((Motor *)c)
#define FUNCTION(name, ...) fmi2Status name(fmi2Component c, __VA_ARGS__)

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
FUNCTION(fmi2SetDebugLogging, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }

#ifndef NO_INSTANTIATE
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    Motor *m = create();
    if (m != NULL) m->callbacks = functions;
    return m;
}
#endif
void fmi2FreeInstance(fmi2Component c) { destroy(c); }
FUNCTION(fmi2SetupExperiment, fmi2Boolean td, fmi2Real t, fmi2Real from, fmi2Boolean sd, fmi2Real stop) {
    return set_up(c, from, sd, stop) ? fmi2OK : fmi2Error;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    M->initialised = 1;
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
#ifndef NO_RESET
fmi2Status fmi2Reset(fmi2Component c) {
#if defined(CRASHING_RESET)
    abort();
#elif defined(FAILING_RESET)
    return fmi2Error;
#elif !defined(IDLE_RESET)
    start(c);
#endif
    return fmi2OK;
}
#endif

#define ACCESS(TYPE, get, set)                                                                                        \
    FUNCTION(fmi2Get##TYPE, const fmi2ValueReference r[], size_t n, fmi2##TYPE v[]) {                                 \
        for (size_t k = 0; k < n; k++) get;                                                                           \
        return fmi2OK;                                                                                                \
    }                                                                                                                 \
    FUNCTION(fmi2Set##TYPE, const fmi2ValueReference r[], size_t n, const fmi2##TYPE v[]) {                           \
        for (size_t k = 0; k < n; k++) set;                                                                           \
        return fmi2OK;                                                                                                \
    }
ACCESS(Real, v[k] = shown(M, r[k]), take(M, r[k], v[k]))
ACCESS(Integer, v[k] = r[k] == 1 ? (int)(M->values[SPEED] * 100) : M->mode, M->mode = v[k])
ACCESS(Boolean, v[k] = M->enabled, M->enabled = v[k])
ACCESS(String, v[k] = "", (void)v[k])

#ifdef INTERPOLATES
FUNCTION(fmi2SetRealInputDerivatives, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
         const fmi2Real v[]) {
    for (size_t k = 0; k < n; k++) {
        if (r[k] != U || order[k] != 1) return fmi2Error;
        M->slope = v[k];
    }
    return fmi2OK;
}
#endif

FUNCTION(fmi2DoStep, fmi2Real time, fmi2Real h, fmi2Boolean same) {
    return advance(c, time, h) ? fmi2OK : fmi2Discard;
}

/* Model exchange */
fmi2Status fmi2EnterEventMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *e) {
    memset(e, 0, sizeof *e);
    return fmi2OK;
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return fmi2OK; }
FUNCTION(fmi2CompletedIntegratorStep, fmi2Boolean same, fmi2Boolean *event, fmi2Boolean *end) {
    *event = *end = 0;
    return fmi2OK;
}
FUNCTION(fmi2SetTime, fmi2Real time) {
    M->time = time;
    return fmi2OK;
}
FUNCTION(fmi2SetContinuousStates, const fmi2Real x[], size_t n) {
    M->values[CURRENT] = x[0], M->values[SPEED] = x[1];
    return fmi2OK;
}
FUNCTION(fmi2GetContinuousStates, fmi2Real x[], size_t n) {
    x[0] = M->values[CURRENT], x[1] = M->values[SPEED];
    return fmi2OK;
}
FUNCTION(fmi2GetDerivatives, fmi2Real d[], size_t n) {
#ifdef BROKEN_EQUATIONS
    if (M->time > BROKEN_EQUATIONS) return fmi2Error;
#endif
    derivatives(M, (double[]){M->values[CURRENT], M->values[SPEED]}, M->time, d);
    return fmi2OK;
}
FUNCTION(fmi2GetEventIndicators, fmi2Real z[], size_t n) { return fmi2OK; }
FUNCTION(fmi2GetNominalsOfContinuousStates, fmi2Real x[], size_t n) {
    x[0] = 0.1, x[1] = 10;
    return fmi2OK;
}

#ifndef NO_EXTRAS
#define NOT_OFFERED(name, ...)                                                                                        \
    FUNCTION(name, __VA_ARGS__) { return fmi2Error; }
NOT_OFFERED(fmi2GetFMUstate, fmi2FMUstate *s)
NOT_OFFERED(fmi2SetFMUstate, fmi2FMUstate s)
NOT_OFFERED(fmi2FreeFMUstate, fmi2FMUstate *s)
NOT_OFFERED(fmi2SerializedFMUstateSize, fmi2FMUstate s, size_t *n)
NOT_OFFERED(fmi2SerializeFMUstate, fmi2FMUstate s, fmi2Byte b[], size_t n)
NOT_OFFERED(fmi2DeSerializeFMUstate, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
NOT_OFFERED(fmi2GetDirectionalDerivative, const fmi2ValueReference z[], size_t nz, const fmi2ValueReference v[],
            size_t nv, const fmi2Real dv[], fmi2Real dz[])
#ifndef INTERPOLATES
NOT_OFFERED(fmi2SetRealInputDerivatives, const fmi2ValueReference r[], size_t n, const fmi2Integer o[],
            const fmi2Real v[])
#endif
NOT_OFFERED(fmi2GetRealOutputDerivatives, const fmi2ValueReference r[], size_t n, const fmi2Integer o[], fmi2Real v[])
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
NOT_OFFERED(fmi2GetStatus, const fmi2StatusKind k, fmi2Status *v)
NOT_OFFERED(fmi2GetRealStatus, const fmi2StatusKind k, fmi2Real *v)
NOT_OFFERED(fmi2GetIntegerStatus, const fmi2StatusKind k, fmi2Integer *v)
NOT_OFFERED(fmi2GetBooleanStatus, const fmi2StatusKind k, fmi2Boolean *v)
NOT_OFFERED(fmi2GetStringStatus, const fmi2StatusKind k, fmi2String *v)
#endif
