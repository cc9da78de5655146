/* Co-simulation by FMI 2.0. fmi2Functions.h comes from the importer that compiles this. */

#include "variables.h"

#include "fmi2Functions.h"

typedef fmi2ValueReference fmu_reference;
typedef fmi2Integer fmu_integer;

#include "fmu.h"

typedef struct {
    fmu_values values; /* first: an instance is one of these, too */
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    char name[];
} instance;

static void say(fmi2CallbackLogger logger, fmi2ComponentEnvironment environment, fmi2String name, const char *wrong)
{
    if (logger) {
        logger(environment, name, fmi2Error, "logStatusError", wrong);
    }
}

static fmi2Status answer(const instance *own, const char *wrong)
{
    if (wrong) {
        say(own->logger, own->environment, own->name, wrong);
    }
    return wrong ? fmi2Error : fmi2OK;
}

/* Without an instance there is no logger to report the error to. */
#define ANSWER(call) return c ? answer((const instance *)c, call) : fmi2Error

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

/* Errors are always reported; there is nothing else to report. */
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[])
{
    (void)loggingOn;
    ANSWER(nCategories > 0 && !categories ? "null pointer for the categories" : 0);
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    const char *wrong = fmuType == fmi2CoSimulation ? fmu_refused_start(instanceName, fmuGUID) : FMU_ONLY;
    instance *own = 0;
    (void)fmuResourceLocation;
    (void)visible;
    (void)loggingOn;
    if (!functions) {
        return 0; /* there is no logger to report it to */
    }
    if (!wrong) {
        own = (instance *)fmu_new(sizeof *own + strlen(instanceName) + 1);
        wrong = own ? 0 : "no memory for an instance";
    }
    if (wrong) {
        say(functions->logger, functions->componentEnvironment, instanceName ? instanceName : "", wrong);
        return 0;
    }
    own->logger = functions->logger;
    own->environment = functions->componentEnvironment;
    strcpy(own->name, instanceName);
    return own;
}

void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    (void)toleranceDefined;
    (void)tolerance;
    ANSWER(fmu_set_time(c, startTime, stopTimeDefined ? stopTime : HUGE_VAL));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    ANSWER(fmu_enter(c, FMU_INSTANTIATED, FMU_INITIALIZATION));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    ANSWER(fmu_enter(c, FMU_INITIALIZATION, FMU_STEP));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    ANSWER(fmu_enter(c, FMU_STEP, FMU_TERMINATED));
}

fmi2Status fmi2Reset(fmi2Component c)
{
    ANSWER(fmu_reset(c));
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    ANSWER(fmu_get_reals(c, vr, nvr, value, nvr));
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
    ANSWER(fmu_get_integers(c, vr, nvr, value, nvr));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    ANSWER(fmu_set_reals(c, vr, nvr, value, nvr));
}

/* There are no variables of these types to get or to set. */
#define NONE(name, type)                                                                      \
    fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, type value[]) \
    {                                                                                         \
        (void)vr;                                                                             \
        (void)value;                                                                          \
        ANSWER(nvr > 0 ? FMU_UNKNOWN : 0);                                                    \
    }
NONE(fmi2GetBoolean, fmi2Boolean)
NONE(fmi2GetString, fmi2String)
NONE(fmi2SetInteger, const fmi2Integer)
NONE(fmi2SetBoolean, const fmi2Boolean)
NONE(fmi2SetString, const fmi2String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    ANSWER(fmu_get_state(c, FMUstate));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    ANSWER(fmu_set_state(c, FMUstate));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    ANSWER(fmu_free_state(FMUstate));
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    ANSWER(fmu_state_size(FMUstate, size));
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte bytes[], size_t size)
{
    ANSWER(fmu_to_bytes(FMUstate, bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *FMUstate)
{
    ANSWER(fmu_from_bytes(bytes, size, FMUstate));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    ANSWER(fmu_step(c, currentCommunicationPoint, communicationStepSize));
}

/* What the description does not offer. */
#define NOT_OFFERED(name, ...)                   \
    fmi2Status name(fmi2Component c, __VA_ARGS__) \
    {                                            \
        ANSWER("this function is not offered");  \
    }
#define NOT_OFFERED_ALONE(name)                  \
    fmi2Status name(fmi2Component c)             \
    {                                            \
        ANSWER("this function is not offered");  \
    }
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
NOT_OFFERED(fmi2GetDirectionalDerivative, const fmi2ValueReference u[], size_t nu, const fmi2ValueReference k[],
            size_t nk, const fmi2Real dk[], fmi2Real du[])
NOT_OFFERED(fmi2SetRealInputDerivatives, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
            const fmi2Real value[])
NOT_OFFERED(fmi2GetRealOutputDerivatives, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
            fmi2Real value[])
NOT_OFFERED_ALONE(fmi2CancelStep)
NOT_OFFERED(fmi2GetStatus, const fmi2StatusKind s, fmi2Status *value)
NOT_OFFERED(fmi2GetRealStatus, const fmi2StatusKind s, fmi2Real *value)
NOT_OFFERED(fmi2GetIntegerStatus, const fmi2StatusKind s, fmi2Integer *value)
NOT_OFFERED(fmi2GetBooleanStatus, const fmi2StatusKind s, fmi2Boolean *value)
NOT_OFFERED(fmi2GetStringStatus, const fmi2StatusKind s, fmi2String *value)
