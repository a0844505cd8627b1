/* The functions of FMI 3.0, written once for every model. Co-simulation and model exchange; those that are not offered
 * exist, log and return fmi3Error. Knows no model.
 *
 * There are no events of the model's own but changes of mode, no clocks, no arrays and no structural parameters. Allocates with the C
 * library. Messages are complete text. Pointers given at instantiation are copied.
 */
#include "instance.c"

#include "fmi3Functions.h"

typedef struct {
    Instance instance; /* first: a pointer to it is one to this */
    fmi3LogMessageCallback logger;
    fmi3InstanceEnvironment environment;
} Component;

typedef fmi3Status FmiStatus;
typedef fmi3Instance FmiInstance;
typedef fmi3String FmiString;
typedef fmi3Boolean FmiBoolean;
typedef fmi3Byte FmiByte;
#define FMI_NAME(name) fmi3##name
#define FMI_STATE(before, after) fmi3##before##FMUState##after
#define FMI_READ_STATE fmi3DeserializeFMUState
#define FMI_GET_DERIVATIVES fmi3GetContinuousStateDerivatives
#include "fmi.c"

static void fmi3_log(const Instance *instance, Status status, const char *message)
{
    const Component *component = (const Component *)instance;
    component->logger(component->environment, (fmi3Status)status,
                  log_categories[status == INSTANCE_DISCARD ? LOG_DISCARD : LOG_ERROR].name, message);
}

/* ---- Inquiry, creation, logging ---- */

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

/* refusal: why there can be no such instance; NULL: there can. */
static fmi3Instance fmi3_instantiate(bool model_exchange, const char *refusal, fmi3String token, bool loggingOn,
                                     fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
    Component *component = calloc(1, sizeof *component);
    if (component == NULL) return NULL;
    if (logger != NULL) {
        component->logger = logger;
        component->environment = environment;
        component->instance.log = fmi3_log;
    }
    component->instance.log_discard = component->instance.log_error = loggingOn;
    component->instance.model_exchange = model_exchange;
    instance_reset(&component->instance);
    if (refusal == NULL && (token == NULL || strcmp(token, MODEL_GUID) != 0))
        refusal = "wrong instantiation token: this binary and that modelDescription.xml do not belong together";
    if (refusal == NULL) return component;
    (void)fmi_error(component, refusal);
    free(component);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    (void)instanceName;
    (void)resourcePath;
    (void)visible;
    return fmi3_instantiate(true, NULL, instantiationToken, loggingOn, instanceEnvironment, logMessage);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                         fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate)
{
    (void)instanceName;
    (void)resourcePath;
    (void)visible;
    (void)earlyReturnAllowed; /* it never returns early, and updates nothing on the way */
    (void)requiredIntermediateVariables;
    (void)nRequiredIntermediateVariables;
    (void)intermediateUpdate;
    return fmi3_instantiate(false, eventModeUsed ? "event mode is not offered in co-simulation" : NULL,
                            instantiationToken, loggingOn, instanceEnvironment, logMessage);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken,
                                               fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment,
                                               fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
                                               fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)instanceName;
    (void)resourcePath;
    (void)visible;
    (void)clockUpdate;
    (void)lockPreemption;
    (void)unlockPreemption;
    return fmi3_instantiate(false, "scheduled execution is not offered by this FMU", instantiationToken, loggingOn,
                            instanceEnvironment, logMessage);
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

/* ---- Phases ---- */

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    Status status;
    (void)toleranceDefined; /* the integrator is exact, or has its own, tight one */
    (void)tolerance;
    if (instance == NULL) return fmi3Error;
    status = instance_set_up(instance, startTime, stopTimeDefined, stopTime);
    if (status != INSTANCE_OK) return (fmi3Status)status;
    return (fmi3Status)instance_enter(instance, PHASE_INSTANTIATED, PHASE_INITIALIZATION, "entering initialisation");
}

/* ---- Values ---- */

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Float64 values[], size_t nValues)
{
    if (instance == NULL) return fmi3Error;
    if (nValues != nValueReferences) return fmi_error(instance, "as many values as references are needed");
    return (fmi3Status)instance_get(instance, N_VARIABLES + 1, valueReferences, nValueReferences, values);
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Float64 values[], size_t nValues)
{
    if (instance == NULL) return fmi3Error;
    if (nValues != nValueReferences) return fmi_error(instance, "as many values as references are needed");
    return (fmi3Status)instance_set(instance, valueReferences, nValueReferences, values);
}

/* All variables are of type Float64. */
#define NO_SUCH_VARIABLES(function, type)                                                                    \
    fmi3Status function(fmi3Instance instance, const fmi3ValueReference valueReferences[],                   \
                        size_t nValueReferences, type values[], size_t nValues)                              \
    {                                                                                                        \
        (void)valueReferences;                                                                               \
        (void)values;                                                                                        \
        return instance != NULL && nValueReferences == 0 && nValues == 0 ? fmi3OK                            \
                                                                         : fmi_not_offered(instance, #function); \
    }
NO_SUCH_VARIABLES(fmi3GetFloat32, fmi3Float32)
NO_SUCH_VARIABLES(fmi3GetInt8, fmi3Int8)
NO_SUCH_VARIABLES(fmi3GetUInt8, fmi3UInt8)
NO_SUCH_VARIABLES(fmi3GetInt16, fmi3Int16)
NO_SUCH_VARIABLES(fmi3GetUInt16, fmi3UInt16)
NO_SUCH_VARIABLES(fmi3GetInt32, fmi3Int32)
NO_SUCH_VARIABLES(fmi3GetUInt32, fmi3UInt32)
NO_SUCH_VARIABLES(fmi3GetInt64, fmi3Int64)
NO_SUCH_VARIABLES(fmi3GetUInt64, fmi3UInt64)
NO_SUCH_VARIABLES(fmi3GetBoolean, fmi3Boolean)
NO_SUCH_VARIABLES(fmi3GetString, fmi3String)
NO_SUCH_VARIABLES(fmi3SetFloat32, const fmi3Float32)
NO_SUCH_VARIABLES(fmi3SetInt8, const fmi3Int8)
NO_SUCH_VARIABLES(fmi3SetUInt8, const fmi3UInt8)
NO_SUCH_VARIABLES(fmi3SetInt16, const fmi3Int16)
NO_SUCH_VARIABLES(fmi3SetUInt16, const fmi3UInt16)
NO_SUCH_VARIABLES(fmi3SetInt32, const fmi3Int32)
NO_SUCH_VARIABLES(fmi3SetUInt32, const fmi3UInt32)
NO_SUCH_VARIABLES(fmi3SetInt64, const fmi3Int64)
NO_SUCH_VARIABLES(fmi3SetUInt64, const fmi3UInt64)
NO_SUCH_VARIABLES(fmi3SetBoolean, const fmi3Boolean)
NO_SUCH_VARIABLES(fmi3SetString, const fmi3String)

/* ---- Co-simulation ---- */

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    Status status;
    (void)noSetFMUStatePriorToCurrentPoint; /* every state can be restored */
    if (instance == NULL) return fmi3Error;
    status = instance_step(instance, currentCommunicationPoint, communicationStepSize);
    if (eventHandlingNeeded != NULL) *eventHandlingNeeded = fmi3False;
    if (terminateSimulation != NULL) *terminateSimulation = fmi3False;
    if (earlyReturn != NULL) *earlyReturn = fmi3False;
    if (lastSuccessfulTime != NULL) *lastSuccessfulTime = *instance_time(instance);
    return (fmi3Status)status;
}

/* ---- Derivatives of outputs and derivatives ---- */

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                        size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    if (instance == NULL) return fmi3Error;
    if (nSeed != nKnowns || nSensitivity != nUnknowns)
        return fmi_error(instance, "as many seeds as knowns and sensitivities as unknowns are needed");
    return (fmi3Status)instance_differentiate(instance, unknowns, nUnknowns, knowns, nKnowns, seed, sensitivity);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    if (instance == NULL) return fmi3Error;
    if (nSeed != nUnknowns || nSensitivity != nKnowns)
        return fmi_error(instance, "as many seeds as unknowns and sensitivities as knowns are needed");
    if (!is_given(unknowns, nUnknowns) || !is_given(knowns, nKnowns) || !is_given(seed, nSeed) ||
        !is_given(sensitivity, nSensitivity))
        return (fmi3Status)instance_miss(instance);
    for (size_t k = 0; k < nKnowns; k++) {
        const double one = 1;
        double sum = 0;
        for (size_t u = 0; u < nUnknowns; u++) {
            double entry = 0;
            const Status status = instance_differentiate(instance, &unknowns[u], 1, &knowns[k], 1, &one, &entry);
            if (status != INSTANCE_OK) return (fmi3Status)status;
            sum += seed[u] * entry;
        }
        sensitivity[k] = sum;
    }
    return fmi3OK;
}

/* ---- Model exchange: events are changes of mode, and those in which the importer changes a parameter ---- */

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    if (instance == NULL) return fmi3Error;
    if (!instance_exchanges(instance, PHASE_INITIALIZATION, PHASE_EVENT))
        return (fmi3Status)instance_refuse(instance, "evaluating discrete states");
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime)
{
    bool changed;
    Status status;
    if (instance == NULL) return fmi3Error;
    if (!instance_exchanges(instance, PHASE_EVENT, PHASE_EVENT))
        return (fmi3Status)instance_refuse(instance, "updating discrete states");
    status = instance_settle(instance, &changed);
    if (discreteStatesNeedUpdate != NULL) *discreteStatesNeedUpdate = fmi3False;
    if (terminateSimulation != NULL) *terminateSimulation = fmi3False;
    if (nominalsOfContinuousStatesChanged != NULL) *nominalsOfContinuousStatesChanged = fmi3False;
    if (valuesOfContinuousStatesChanged != NULL) *valuesOfContinuousStatesChanged = changed;
    if (nextEventTimeDefined != NULL) *nextEventTimeDefined = fmi3False;
    if (nextEventTime != NULL) *nextEventTime = 0;
    return (fmi3Status)status;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    if (instance == NULL) return fmi3Error;
    if (!instance_exchanges(instance, PHASE_CONTINUOUS, PHASE_CONTINUOUS))
        return (fmi3Status)instance_refuse(instance, "completing an integrator step");
    if (enterEventMode != NULL) *enterEventMode = fmi3False;
    if (terminateSimulation != NULL) *terminateSimulation = fmi3False;
    return fmi3OK;
}

static fmi3Status fmi3_count(fmi3Instance instance, size_t count, size_t *asked)
{
    if (instance == NULL || asked == NULL) return fmi3Error;
    if (!((Instance *)instance)->model_exchange)
        return (fmi3Status)instance_refuse(instance, "counting states or event indicators");
    *asked = count;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
    return fmi3_count(instance, N_STATES, nContinuousStates);
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
    return fmi3_count(instance, N_MODES, nEventIndicators);
}

/* ---- Not offered ---- */

#define NOT_OFFERED(function, ...)                        \
    fmi3Status function(fmi3Instance instance __VA_ARGS__) \
    {                                                     \
        return fmi_not_offered(instance, #function);     \
    }
#define REFERENCES , const fmi3ValueReference valueReferences[], size_t nValueReferences

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
NOT_OFFERED(fmi3EnterStepMode, )
NOT_OFFERED(fmi3EnterConfigurationMode, )
NOT_OFFERED(fmi3ExitConfigurationMode, )
NOT_OFFERED(fmi3GetBinary, REFERENCES, size_t valueSizes[], fmi3Binary values[], size_t nValues)
NOT_OFFERED(fmi3SetBinary, REFERENCES, const size_t valueSizes[], const fmi3Binary values[], size_t nValues)
NOT_OFFERED(fmi3GetClock, REFERENCES, fmi3Clock values[])
NOT_OFFERED(fmi3SetClock, REFERENCES, const fmi3Clock values[])
NOT_OFFERED(fmi3GetNumberOfVariableDependencies, , fmi3ValueReference valueReference, size_t *nDependencies)
NOT_OFFERED(fmi3GetVariableDependencies, , fmi3ValueReference dependent, size_t elementIndicesOfDependent[],
            fmi3ValueReference independents[], size_t elementIndicesOfIndependents[],
            fmi3DependencyKind dependencyKinds[], size_t nDependencies)
NOT_OFFERED(fmi3GetOutputDerivatives, REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues)
NOT_OFFERED(fmi3GetIntervalDecimal, REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NOT_OFFERED(fmi3GetIntervalFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
            fmi3IntervalQualifier qualifiers[])
NOT_OFFERED(fmi3GetShiftDecimal, REFERENCES, fmi3Float64 shifts[])
NOT_OFFERED(fmi3GetShiftFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3SetIntervalDecimal, REFERENCES, const fmi3Float64 intervals[])
NOT_OFFERED(fmi3SetIntervalFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3SetShiftDecimal, REFERENCES, const fmi3Float64 shifts[])
NOT_OFFERED(fmi3SetShiftFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3ActivateModelPartition, , fmi3ValueReference clockReference, fmi3Float64 activationTime)
