/* Co-simulation by FMI 3.0. fmi3Functions.h comes from the importer that compiles this. */

#include "variables.h"

#include "fmi3Functions.h"

typedef fmi3ValueReference fmu_reference;
typedef fmi3Int64 fmu_integer;

#include "fmu.h"

typedef struct {
    fmu_values values; /* first: an instance is one of these, too */
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} instance;

static void say(fmi3LogMessageCallback log, fmi3InstanceEnvironment environment, const char *wrong)
{
    if (log) {
        log(environment, fmi3Error, "logStatusError", wrong);
    }
}

static fmi3Status answer(const instance *own, const char *wrong)
{
    if (wrong) {
        say(own->log, own->environment, wrong);
    }
    return wrong ? fmi3Error : fmi3OK;
}

/* Without an instance there is no logger to report the error to. */
#define ANSWER(call) return c ? answer((const instance *)c, call) : fmi3Error

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

/* Errors are always reported; there is nothing else to report. */
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
    (void)loggingOn;
    ANSWER(nCategories > 0 && !categories ? "null pointer for the categories" : 0);
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
    const char *wrong = fmu_refused_start(instanceName, instantiationToken);
    instance *own = 0;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables;
    (void)nRequiredIntermediateVariables;
    (void)intermediateUpdate;
    if (!wrong && eventModeUsed) {
        wrong = "not supported: this FMU has no event mode";
    }
    if (!wrong) {
        own = (instance *)fmu_new(sizeof *own);
        wrong = own ? 0 : "no memory for an instance";
    }
    if (wrong) {
        say(logMessage, instanceEnvironment, wrong);
        return 0;
    }
    own->log = logMessage;
    own->environment = instanceEnvironment;
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
    say(logMessage, instanceEnvironment, FMU_ONLY);
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
    (void)clockUpdate;
    (void)lockPreemption;
    (void)unlockPreemption;
    say(logMessage, instanceEnvironment, FMU_ONLY);
    return 0;
}

void fmi3FreeInstance(fmi3Instance c)
{
    free(c);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    const char *wrong = c ? fmu_set_time(c, startTime, stopTimeDefined ? stopTime : HUGE_VAL) : 0;
    (void)toleranceDefined;
    (void)tolerance;
    ANSWER(wrong ? wrong : fmu_enter(c, FMU_INSTANTIATED, FMU_INITIALIZATION));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    ANSWER(fmu_enter(c, FMU_INITIALIZATION, FMU_STEP));
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    ANSWER(fmu_enter(c, FMU_STEP, FMU_TERMINATED));
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    ANSWER(fmu_reset(c));
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Float64 values[],
                          size_t nValues)
{
    ANSWER(fmu_get_reals(c, vr, nvr, values, nValues));
}

fmi3Status fmi3GetInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Int64 values[], size_t nValues)
{
    ANSWER(fmu_get_integers(c, vr, nvr, values, nValues));
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Float64 values[],
                          size_t nValues)
{
    ANSWER(fmu_set_reals(c, vr, nvr, values, nValues));
}

/* There are no variables of these types to get or to set. */
#define NONE(name, type)                                                                                      \
    fmi3Status name(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, type values[], size_t nValues) \
    {                                                                                                         \
        (void)vr;                                                                                             \
        (void)values;                                                                                         \
        (void)nValues;                                                                                        \
        ANSWER(nvr > 0 ? FMU_UNKNOWN : 0);                                                                    \
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
    ANSWER(fmu_get_state(c, FMUState));
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState FMUState)
{
    ANSWER(fmu_set_state(c, FMUState));
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *FMUState)
{
    ANSWER(fmu_free_state(FMUState));
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState FMUState, size_t *size)
{
    ANSWER(fmu_state_size(FMUState, size));
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState FMUState, fmi3Byte bytes[], size_t size)
{
    ANSWER(fmu_to_bytes(FMUState, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *FMUState)
{
    ANSWER(fmu_from_bytes(bytes, size, FMUState));
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    const char *wrong = 0;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (!eventHandlingNeeded || !terminateSimulation || !earlyReturn || !lastSuccessfulTime) {
        wrong = "null pointer for a result";
    } else if (c) {
        wrong = fmu_step(c, currentCommunicationPoint, communicationStepSize);
        *eventHandlingNeeded = false;
        *terminateSimulation = false;
        *earlyReturn = false;
        *lastSuccessfulTime = ((instance *)c)->values.time_s;
    }
    ANSWER(wrong);
}

/* What the description does not offer. */
#define NOT_OFFERED(name, ...)                   \
    fmi3Status name(fmi3Instance c, __VA_ARGS__) \
    {                                            \
        ANSWER("this function is not offered");  \
    }
#define NOT_OFFERED_ALONE(name)                  \
    fmi3Status name(fmi3Instance c)              \
    {                                            \
        ANSWER("this function is not offered");  \
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
