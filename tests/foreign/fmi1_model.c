/* motor.h as FMI 1.0 for model exchange. The functions carry the model's name. */
#include "motor.h"
#include "fmi1Functions.h"

#define M ((Motor *)c)
#define EXPORT __attribute__((visibility("default")))
#define NAMED(name) foreign_##name
#define FUNCTION(name, ...) EXPORT fmi1Status NAMED(name)(fmi1Component c, __VA_ARGS__)

EXPORT const char *NAMED(fmiGetModelTypesPlatform)(void) { return "standard32"; }
EXPORT const char *NAMED(fmiGetVersion)(void) { return "1.0"; }
FUNCTION(fmiSetDebugLogging, fmi1Boolean on) { return fmi1OK; }
EXPORT fmi1Component NAMED(fmiInstantiateModel)(fmi1String name, fmi1String guid, fmi1CallbackFunctions functions,
                                                fmi1Boolean logging) {
    return create();
}
EXPORT void NAMED(fmiFreeModelInstance)(fmi1Component c) { destroy(c); }

static void no_event(fmi1EventInfo *e) {
    memset(e, 0, sizeof *e);
    e->iterationConverged = 1;
}
FUNCTION(fmiInitialize, fmi1Boolean controlled, fmi1Real tolerance, fmi1EventInfo *e) {
    no_event(e);
    M->initialised = 1;
    return fmi1OK;
}
FUNCTION(fmiEventUpdate, fmi1Boolean intermediate, fmi1EventInfo *e) {
    no_event(e);
    return M->initialised ? fmi1OK : fmi1Error;
}
FUNCTION(fmiCompletedIntegratorStep, fmi1Boolean *event) {
    *event = 0;
    return fmi1OK;
}
FUNCTION(fmiSetTime, fmi1Real time) {
    M->time = time;
    return fmi1OK;
}
FUNCTION(fmiSetContinuousStates, const fmi1Real x[], size_t n) {
    M->values[CURRENT] = x[0], M->values[SPEED] = x[1];
    return fmi1OK;
}
FUNCTION(fmiGetContinuousStates, fmi1Real x[], size_t n) {
    x[0] = M->values[CURRENT], x[1] = M->values[SPEED];
    return fmi1OK;
}
FUNCTION(fmiGetDerivatives, fmi1Real d[], size_t n) {
    derivatives(M, (double[]){M->values[CURRENT], M->values[SPEED]}, M->time, d);
    return M->initialised ? fmi1OK : fmi1Error;
}
FUNCTION(fmiGetEventIndicators, fmi1Real z[], size_t n) { return fmi1OK; }
FUNCTION(fmiGetNominalContinuousStates, fmi1Real x[], size_t n) {
    x[0] = 0.1, x[1] = 10;
    return fmi1OK;
}
FUNCTION(fmiGetStateValueReferences, fmi1ValueReference r[], size_t n) {
    r[0] = CURRENT, r[1] = SPEED;
    return fmi1OK;
}
EXPORT fmi1Status NAMED(fmiTerminate)(fmi1Component c) { return fmi1OK; }

#define ACCESS(TYPE, get, set)                                                                                        \
    FUNCTION(fmiGet##TYPE, const fmi1ValueReference r[], size_t n, fmi1##TYPE v[]) {                                  \
        for (size_t k = 0; k < n; k++) get;                                                                           \
        return fmi1OK;                                                                                                \
    }                                                                                                                 \
    FUNCTION(fmiSet##TYPE, const fmi1ValueReference r[], size_t n, const fmi1##TYPE v[]) {                            \
        for (size_t k = 0; k < n; k++) set;                                                                           \
        return fmi1OK;                                                                                                \
    }
ACCESS(Real, v[k] = shown(M, r[k]), take(M, r[k], v[k]))
ACCESS(Integer, v[k] = M->mode, M->mode = v[k])
ACCESS(Boolean, v[k] = (char)M->enabled, M->enabled = v[k])
ACCESS(String, v[k] = "", (void)v[k])
