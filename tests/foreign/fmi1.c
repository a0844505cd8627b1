/* motor.h as FMI 1.0 for co-simulation. The functions carry the model's name. */
#include "motor.h"
#include "fmi1Functions.h"

#define M ((Motor *)c)
#define NAMED(name) foreign_##name
#define FUNCTION(name, ...) __attribute__((visibility("default"))) fmi1Status NAMED(name)(fmi1Component c, __VA_ARGS__)
#define PLAIN(name) __attribute__((visibility("default"))) fmi1Status NAMED(name)(fmi1Component c)

__attribute__((visibility("default"))) const char *NAMED(fmiGetTypesPlatform)(void) { return "standard32"; }
__attribute__((visibility("default"))) const char *NAMED(fmiGetVersion)(void) { return "1.0"; }
FUNCTION(fmiSetDebugLogging, fmi1Boolean on) { return fmi1OK; }
__attribute__((visibility("default"))) fmi1Component
NAMED(fmiInstantiateSlave)(fmi1String name, fmi1String guid, fmi1String location, fmi1String mime, fmi1Real timeout,
                           fmi1Boolean visible, fmi1Boolean interactive, fmi1CallbackFunctions functions,
                           fmi1Boolean logging) {
    return create();
}
FUNCTION(fmiInitializeSlave, fmi1Real from, fmi1Boolean stops, fmi1Real stop) {
    M->initialised = 1;
    return set_up(c, from, stops, stop) ? fmi1OK : fmi1Error;
}
PLAIN(fmiTerminateSlave) { return fmi1OK; }
PLAIN(fmiResetSlave) {
    start(c);
    return fmi1OK;
}
__attribute__((visibility("default"))) void NAMED(fmiFreeSlaveInstance)(fmi1Component c) { destroy(c); }
FUNCTION(fmiDoStep, fmi1Real time, fmi1Real h, fmi1Boolean new) { return advance(c, time, h) ? fmi1OK : fmi1Discard; }
PLAIN(fmiCancelStep) { return fmi1Error; }

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

#define NOT_OFFERED(name, ...)                                                                                        \
    FUNCTION(name, __VA_ARGS__) { return fmi1Error; }
NOT_OFFERED(fmiSetRealInputDerivatives, const fmi1ValueReference r[], size_t n, const fmi1Integer o[],
            const fmi1Real v[])
NOT_OFFERED(fmiGetRealOutputDerivatives, const fmi1ValueReference r[], size_t n, const fmi1Integer o[], fmi1Real v[])
NOT_OFFERED(fmiGetStatus, int k, fmi1Status *v)
NOT_OFFERED(fmiGetRealStatus, int k, fmi1Real *v)
NOT_OFFERED(fmiGetIntegerStatus, int k, fmi1Integer *v)
NOT_OFFERED(fmiGetBooleanStatus, int k, fmi1Boolean *v)
NOT_OFFERED(fmiGetStringStatus, int k, fmi1String *v)
