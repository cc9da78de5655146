/* Co-simulation by FMI 3.0. fmi3Functions.h comes from the importer that compiles this. */

#include "fmi3Functions.h"

#include "fmu.h"

typedef struct {
    fmu_values values;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} instance;

static fmi3Status refuse(instance *own, const char *message)
{
    if (own->log) {
        own->log(own->environment, fmi3Error, "logStatusError", message);
    }
    return fmi3Error;
}

static fmi3Status enter(instance *own, fmu_phase from, fmu_phase to)
{
    if (own->values.phase != from) {
        return refuse(own, "this function may not be called now");
    }
    fmu_settle(&own->values);
    own->values.phase = to;
    return fmi3OK;
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

/* Errors are always reported; there is nothing else to report. */
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
    (void)nCategories;
    (void)categories;
    (void)c;
    (void)loggingOn;
    return fmi3OK;
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
    instance *own;
    (void)instanceName;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    (void)eventModeUsed;
    (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables;
    (void)nRequiredIntermediateVariables;
    (void)intermediateUpdate;
    if (!instantiationToken || strcmp(instantiationToken, FMU_TOKEN) != 0) {
        return 0;
    }
    own = (instance *)calloc(1, sizeof *own);
    if (own) {
        fmu_reset(&own->values);
        own->log = logMessage;
        own->environment = instanceEnvironment;
    }
    return own;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    (void)instanceName;
    (void)instantiationToken;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    (void)instanceEnvironment;
    (void)logMessage;
    return 0;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken,
                                               fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment,
                                               fmi3LogMessageCallback logMessage,
                                               fmi3ClockUpdateCallback clockUpdate,
                                               fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)instanceName;
    (void)instantiationToken;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    (void)instanceEnvironment;
    (void)logMessage;
    (void)clockUpdate;
    (void)lockPreemption;
    (void)unlockPreemption;
    return 0;
}

void fmi3FreeInstance(fmi3Instance c)
{
    free(c);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    instance *own = (instance *)c;
    const char *wrong;
    (void)toleranceDefined;
    (void)tolerance;
    if (own->values.phase != FMU_INSTANTIATED) {
        return refuse(own, "this function may not be called now");
    }
    wrong = fmu_set_time(&own->values, startTime, stopTimeDefined ? stopTime : HUGE_VAL);
    return wrong ? refuse(own, wrong) : enter(own, FMU_INSTANTIATED, FMU_INITIALIZATION);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    return enter((instance *)c, FMU_INITIALIZATION, FMU_STEP);
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    return enter((instance *)c, FMU_STEP, FMU_TERMINATED);
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    fmu_reset(&((instance *)c)->values);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Float64 values[],
                          size_t nValues)
{
    instance *own = (instance *)c;
    size_t k;
    fmu_settle(&own->values);
    for (k = 0; k < nvr; ++k) {
        if (k >= nValues || !fmu_get(&own->values, vr[k], &values[k])) {
            return refuse(own, "there is no such variable of this type");
        }
    }
    return fmi3OK;
}

fmi3Status fmi3GetInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Int64 values[], size_t nValues)
{
    instance *own = (instance *)c;
    size_t k;
    fmu_settle(&own->values);
    for (k = 0; k < nvr; ++k) {
        int mode;
        if (k >= nValues || !fmu_get_integer(&own->values, vr[k], &mode)) {
            return refuse(own, "there is no such variable of this type");
        }
        values[k] = mode;
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Float64 values[],
                          size_t nValues)
{
    instance *own = (instance *)c;
    size_t k;
    for (k = 0; k < nvr; ++k) {
        const char *wrong = k < nValues ? fmu_refusal(&own->values, vr[k], values[k]) : "there are too few values";
        if (wrong) {
            return refuse(own, wrong);
        }
    }
    for (k = 0; k < nvr; ++k) {
        fmu_put(&own->values, vr[k], values[k]);
    }
    return fmi3OK;
}

/* There are no variables of these types to get or to set. */
#define NONE(name, type)                                                                                            \
    fmi3Status name(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, type values[], size_t nValues)       \
    {                                                                                                               \
        (void)vr;                                                                                                   \
        (void)values;                                                                                               \
        (void)nValues;                                                                                              \
        return nvr == 0 ? fmi3OK : refuse((instance *)c, "there is no such variable of this type");                 \
    }
NONE(fmi3GetFloat32, fmi3Float32)
NONE(fmi3GetInt8, fmi3Int8)
NONE(fmi3GetUInt8, fmi3UInt8)
NONE(fmi3GetInt16, fmi3Int16)
NONE(fmi3GetUInt16, fmi3UInt16)
NONE(fmi3GetInt32, fmi3Int32)
NONE(fmi3GetUInt32, fmi3UInt32)
NONE(fmi3GetUInt64, fmi3UInt64)
NONE(fmi3GetBoolean, fmi3Boolean)
NONE(fmi3GetString, fmi3String)
NONE(fmi3SetFloat32, const fmi3Float32)
NONE(fmi3SetInt8, const fmi3Int8)
NONE(fmi3SetUInt8, const fmi3UInt8)
NONE(fmi3SetInt16, const fmi3Int16)
NONE(fmi3SetUInt16, const fmi3UInt16)
NONE(fmi3SetInt32, const fmi3Int32)
NONE(fmi3SetUInt32, const fmi3UInt32)
NONE(fmi3SetInt64, const fmi3Int64)
NONE(fmi3SetUInt64, const fmi3UInt64)
NONE(fmi3SetBoolean, const fmi3Boolean)
NONE(fmi3SetString, const fmi3String)

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *FMUState)
{
    instance *own = (instance *)c;
    if (!*FMUState) {
        *FMUState = malloc(sizeof(fmu_values));
    }
    if (!*FMUState) {
        return refuse(own, "no memory for a state");
    }
    fmu_settle(&own->values);
    memcpy(*FMUState, &own->values, sizeof own->values);
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState FMUState)
{
    memcpy(&((instance *)c)->values, FMUState, sizeof(fmu_values));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *FMUState)
{
    (void)c;
    free(*FMUState);
    *FMUState = 0;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState FMUState, size_t *size)
{
    (void)c;
    (void)FMUState;
    *size = sizeof(fmu_values);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState FMUState, fmi3Byte bytes[], size_t size)
{
    if (size < sizeof(fmu_values)) {
        return refuse((instance *)c, "a state needs more bytes");
    }
    memcpy(bytes, FMUState, sizeof(fmu_values));
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *FMUState)
{
    if (size != sizeof(fmu_values) || memcmp(bytes, FMU_TOKEN, sizeof FMU_TOKEN) != 0) {
        return refuse((instance *)c, "these bytes are no state of this model");
    }
    *FMUState = malloc(size);
    if (!*FMUState) {
        return refuse((instance *)c, "no memory for a state");
    }
    memcpy(*FMUState, bytes, size);
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    instance *own = (instance *)c;
    const char *wrong;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (own->values.phase != FMU_STEP) {
        return refuse(own, "this function may not be called now");
    }
    wrong = fmu_step(&own->values, currentCommunicationPoint, communicationStepSize);
    *eventHandlingNeeded = false;
    *terminateSimulation = false;
    *earlyReturn = false;
    *lastSuccessfulTime = own->values.time_s;
    return wrong ? refuse(own, wrong) : fmi3OK;
}

/* What the description does not offer. */
#define NOT_OFFERED(name, ...)                                              \
    fmi3Status name(fmi3Instance c, __VA_ARGS__)                           \
    {                                                                       \
        return refuse((instance *)c, "this function is not offered");       \
    }
#define NOT_OFFERED_ALONE(name)                                             \
    fmi3Status name(fmi3Instance c)                                        \
    {                                                                       \
        return refuse((instance *)c, "this function is not offered");       \
    }
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
NOT_OFFERED_ALONE(fmi3EnterEventMode)
NOT_OFFERED(fmi3GetBinary, const fmi3ValueReference valueReferences[], size_t nValueReferences, size_t valueSizes[],
            fmi3Binary values[], size_t nValues)
NOT_OFFERED(fmi3GetClock, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3Clock values[])
NOT_OFFERED(fmi3SetBinary, const fmi3ValueReference valueReferences[], size_t nValueReferences, const size_t
            valueSizes[], const fmi3Binary values[], size_t nValues)
NOT_OFFERED(fmi3SetClock, const fmi3ValueReference valueReferences[], size_t nValueReferences, const fmi3Clock
            values[])
NOT_OFFERED(fmi3GetNumberOfVariableDependencies, fmi3ValueReference valueReference, size_t* nDependencies)
NOT_OFFERED(fmi3GetVariableDependencies, fmi3ValueReference dependent, size_t elementIndicesOfDependent[],
            fmi3ValueReference independents[], size_t elementIndicesOfIndependents[], fmi3DependencyKind
            dependencyKinds[], size_t nDependencies)
NOT_OFFERED(fmi3GetDirectionalDerivative, const fmi3ValueReference unknowns[], size_t nUnknowns, const
            fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64
            sensitivity[], size_t nSensitivity)
NOT_OFFERED(fmi3GetAdjointDerivative, const fmi3ValueReference unknowns[], size_t nUnknowns, const fmi3ValueReference
            knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[], size_t
            nSensitivity)
NOT_OFFERED_ALONE(fmi3EnterConfigurationMode)
NOT_OFFERED_ALONE(fmi3ExitConfigurationMode)
NOT_OFFERED(fmi3GetIntervalDecimal, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3Float64
            intervals[], fmi3IntervalQualifier qualifiers[])
NOT_OFFERED(fmi3GetIntervalFraction, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3UInt64
            counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
NOT_OFFERED(fmi3GetShiftDecimal, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3Float64
            shifts[])
NOT_OFFERED(fmi3GetShiftFraction, const fmi3ValueReference valueReferences[], size_t nValueReferences, fmi3UInt64
            counters[], fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3SetIntervalDecimal, const fmi3ValueReference valueReferences[], size_t nValueReferences, const
            fmi3Float64 intervals[])
NOT_OFFERED(fmi3SetIntervalFraction, const fmi3ValueReference valueReferences[], size_t nValueReferences, const
            fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3SetShiftDecimal, const fmi3ValueReference valueReferences[], size_t nValueReferences, const
            fmi3Float64 shifts[])
NOT_OFFERED(fmi3SetShiftFraction, const fmi3ValueReference valueReferences[], size_t nValueReferences, const
            fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NOT_OFFERED_ALONE(fmi3EvaluateDiscreteStates)
NOT_OFFERED(fmi3UpdateDiscreteStates, fmi3Boolean* discreteStatesNeedUpdate, fmi3Boolean* terminateSimulation,
            fmi3Boolean* nominalsOfContinuousStatesChanged, fmi3Boolean* valuesOfContinuousStatesChanged, fmi3Boolean*
            nextEventTimeDefined, fmi3Float64* nextEventTime)
NOT_OFFERED_ALONE(fmi3EnterContinuousTimeMode)
NOT_OFFERED(fmi3CompletedIntegratorStep, fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean* enterEventMode,
            fmi3Boolean* terminateSimulation)
NOT_OFFERED(fmi3SetTime, fmi3Float64 time)
NOT_OFFERED(fmi3SetContinuousStates, const fmi3Float64 continuousStates[], size_t nContinuousStates)
NOT_OFFERED(fmi3GetContinuousStateDerivatives, fmi3Float64 derivatives[], size_t nContinuousStates)
NOT_OFFERED(fmi3GetEventIndicators, fmi3Float64 eventIndicators[], size_t nEventIndicators)
NOT_OFFERED(fmi3GetContinuousStates, fmi3Float64 continuousStates[], size_t nContinuousStates)
NOT_OFFERED(fmi3GetNominalsOfContinuousStates, fmi3Float64 nominals[], size_t nContinuousStates)
NOT_OFFERED(fmi3GetNumberOfEventIndicators, size_t* nEventIndicators)
NOT_OFFERED(fmi3GetNumberOfContinuousStates, size_t* nContinuousStates)
NOT_OFFERED_ALONE(fmi3EnterStepMode)
NOT_OFFERED(fmi3GetOutputDerivatives, const fmi3ValueReference valueReferences[], size_t nValueReferences, const
            fmi3Int32 orders[], fmi3Float64 values[], size_t nValues)
NOT_OFFERED(fmi3ActivateModelPartition, fmi3ValueReference clockReference, fmi3Float64 activationTime)
