/* motor.h as FMI 3.0 for co-simulation. What it does not offer returns Error, whatever the arguments. */
#include "motor.h"
#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))
#define M ((Motor *)c)

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[]) { return fmi3OK; }
EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    return create();
}
EXPORT void *fmi3InstantiateModelExchange(void) { return NULL; }
EXPORT void *fmi3InstantiateScheduledExecution(void) { return NULL; }
EXPORT void fmi3FreeInstance(fmi3Instance c) { destroy(c); }
EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean td, fmi3Float64 t, fmi3Float64 from,
                                              fmi3Boolean sd, fmi3Float64 stop) {
    return set_up(c, from, sd, stop) ? fmi3OK : fmi3Error;
}
EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    M->initialised = 1;
    return fmi3OK;
}
EXPORT fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }
EXPORT fmi3Status fmi3Reset(fmi3Instance c) {
    start(c);
    return fmi3OK;
}
EXPORT fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 h, fmi3Boolean same, fmi3Boolean *event,
                             fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached) {
    *event = *end = *early = 0;
    *reached = time + h;
    return advance(c, time, h) ? fmi3OK : fmi3Discard;
}

#define ACCESS(TYPE, get, set)                                                                                        \
    EXPORT fmi3Status fmi3Get##TYPE(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3##TYPE v[],           \
                                    size_t m) {                                                                       \
        for (size_t k = 0; k < n; k++) get;                                                                           \
        return fmi3OK;                                                                                                \
    }                                                                                                                 \
    EXPORT fmi3Status fmi3Set##TYPE(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3##TYPE v[],     \
                                    size_t m) {                                                                       \
        for (size_t k = 0; k < n; k++) set;                                                                           \
        return fmi3OK;                                                                                                \
    }
ACCESS(Float64, v[k] = shown(M, r[k]), take(M, r[k], v[k]))
ACCESS(Float32, v[k] = (float)shown(M, r[k]), take(M, r[k], v[k]))
ACCESS(Int64, v[k] = M->mode, M->mode = (int)v[k])
ACCESS(Boolean, v[k] = M->enabled, M->enabled = v[k])

#define NOT_OFFERED(name)                                                                                             \
    EXPORT fmi3Status name(void) { return fmi3Error; }
NOT_OFFERED(fmi3EnterEventMode)
NOT_OFFERED(fmi3GetInt8)
NOT_OFFERED(fmi3GetUInt8)
NOT_OFFERED(fmi3GetInt16)
NOT_OFFERED(fmi3GetUInt16)
NOT_OFFERED(fmi3GetInt32)
NOT_OFFERED(fmi3GetUInt32)
NOT_OFFERED(fmi3GetUInt64)
NOT_OFFERED(fmi3GetString)
NOT_OFFERED(fmi3GetBinary)
NOT_OFFERED(fmi3GetClock)
NOT_OFFERED(fmi3SetInt8)
NOT_OFFERED(fmi3SetUInt8)
NOT_OFFERED(fmi3SetInt16)
NOT_OFFERED(fmi3SetUInt16)
NOT_OFFERED(fmi3SetInt32)
NOT_OFFERED(fmi3SetUInt32)
NOT_OFFERED(fmi3SetUInt64)
NOT_OFFERED(fmi3SetString)
NOT_OFFERED(fmi3SetBinary)
NOT_OFFERED(fmi3SetClock)
NOT_OFFERED(fmi3GetNumberOfVariableDependencies)
NOT_OFFERED(fmi3GetVariableDependencies)
NOT_OFFERED(fmi3GetFMUState)
NOT_OFFERED(fmi3SetFMUState)
NOT_OFFERED(fmi3FreeFMUState)
NOT_OFFERED(fmi3SerializedFMUStateSize)
NOT_OFFERED(fmi3SerializeFMUState)
NOT_OFFERED(fmi3DeserializeFMUState)
NOT_OFFERED(fmi3GetDirectionalDerivative)
NOT_OFFERED(fmi3GetAdjointDerivative)
NOT_OFFERED(fmi3EnterConfigurationMode)
NOT_OFFERED(fmi3ExitConfigurationMode)
NOT_OFFERED(fmi3GetIntervalDecimal)
NOT_OFFERED(fmi3GetIntervalFraction)
NOT_OFFERED(fmi3GetShiftDecimal)
NOT_OFFERED(fmi3GetShiftFraction)
NOT_OFFERED(fmi3SetIntervalDecimal)
NOT_OFFERED(fmi3SetIntervalFraction)
NOT_OFFERED(fmi3SetShiftDecimal)
NOT_OFFERED(fmi3SetShiftFraction)
NOT_OFFERED(fmi3EvaluateDiscreteStates)
NOT_OFFERED(fmi3UpdateDiscreteStates)
NOT_OFFERED(fmi3EnterContinuousTimeMode)
NOT_OFFERED(fmi3CompletedIntegratorStep)
NOT_OFFERED(fmi3SetTime)
NOT_OFFERED(fmi3SetContinuousStates)
NOT_OFFERED(fmi3GetContinuousStateDerivatives)
NOT_OFFERED(fmi3GetEventIndicators)
NOT_OFFERED(fmi3GetContinuousStates)
NOT_OFFERED(fmi3GetNominalsOfContinuousStates)
NOT_OFFERED(fmi3GetNumberOfEventIndicators)
NOT_OFFERED(fmi3GetNumberOfContinuousStates)
NOT_OFFERED(fmi3EnterStepMode)
NOT_OFFERED(fmi3GetOutputDerivatives)
NOT_OFFERED(fmi3ActivateModelPartition)
