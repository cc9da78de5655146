/* Co-simulation by FMI 2.0. fmi2Functions.h comes from the importer that compiles this. */

#include "fmi2Functions.h"

#include "fmu.h"

typedef struct {
    fmu_values values;
    const fmi2CallbackFunctions *functions;
    char name[64];
} instance;

static fmi2Status refuse(instance *own, const char *message)
{
    if (own->functions->logger) {
        /* A format without conversions: no message has a percent sign. */
        own->functions->logger(own->functions->componentEnvironment, own->name, fmi2Error, "logStatusError", message);
    }
    return fmi2Error;
}

static fmi2Status answer(instance *own, const char *wrong)
{
    return wrong ? refuse(own, wrong) : fmi2OK;
}

static fmi2Status enter(instance *own, fmu_phase from, fmu_phase to)
{
    if (own->values.phase != from) {
        return refuse(own, "this function may not be called now");
    }
    fmu_settle(&own->values);
    own->values.phase = to;
    return fmi2OK;
}

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
    (void)nCategories;
    (void)categories;
    (void)c;
    (void)loggingOn;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    instance *own;
    (void)fmuResourceLocation;
    (void)visible;
    (void)loggingOn;
    if (!functions || fmuType != fmi2CoSimulation || !fmuGUID || strcmp(fmuGUID, FMU_TOKEN) != 0) {
        return 0;
    }
    own = (instance *)calloc(1, sizeof *own);
    if (own) {
        fmu_reset(&own->values);
        own->functions = functions;
        strncpy(own->name, instanceName ? instanceName : "", sizeof own->name - 1);
    }
    return own;
}

void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    instance *own = (instance *)c;
    (void)toleranceDefined;
    (void)tolerance;
    if (own->values.phase != FMU_INSTANTIATED) {
        return refuse(own, "this function may not be called now");
    }
    return answer(own, fmu_set_time(&own->values, startTime, stopTimeDefined ? stopTime : HUGE_VAL));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return enter((instance *)c, FMU_INSTANTIATED, FMU_INITIALIZATION);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return enter((instance *)c, FMU_INITIALIZATION, FMU_STEP);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    return enter((instance *)c, FMU_STEP, FMU_TERMINATED);
}

fmi2Status fmi2Reset(fmi2Component c)
{
    fmu_reset(&((instance *)c)->values);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    instance *own = (instance *)c;
    size_t k;
    fmu_settle(&own->values);
    for (k = 0; k < nvr; ++k) {
        if (!fmu_get(&own->values, vr[k], &value[k])) {
            return refuse(own, "there is no such variable of this type");
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
    instance *own = (instance *)c;
    size_t k;
    fmu_settle(&own->values);
    for (k = 0; k < nvr; ++k) {
        int mode;
        if (!fmu_get_integer(&own->values, vr[k], &mode)) {
            return refuse(own, "there is no such variable of this type");
        }
        value[k] = mode;
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    instance *own = (instance *)c;
    size_t k;
    for (k = 0; k < nvr; ++k) {
        const char *wrong = fmu_refusal(&own->values, vr[k], value[k]);
        if (wrong) {
            return refuse(own, wrong);
        }
    }
    for (k = 0; k < nvr; ++k) {
        fmu_put(&own->values, vr[k], value[k]);
    }
    return fmi2OK;
}

/* There are no variables of these types to get or to set. */
#define NONE(name, type)                                                                              \
    fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, type value[])         \
    {                                                                                                 \
        (void)vr;                                                                                     \
        (void)value;                                                                                  \
        return nvr == 0 ? fmi2OK : refuse((instance *)c, "there is no such variable of this type");   \
    }
NONE(fmi2GetBoolean, fmi2Boolean)
NONE(fmi2GetString, fmi2String)
NONE(fmi2SetInteger, const fmi2Integer)
NONE(fmi2SetBoolean, const fmi2Boolean)
NONE(fmi2SetString, const fmi2String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    instance *own = (instance *)c;
    if (!*FMUstate) {
        *FMUstate = malloc(sizeof(fmu_values));
    }
    if (!*FMUstate) {
        return refuse(own, "no memory for a state");
    }
    fmu_settle(&own->values);
    memcpy(*FMUstate, &own->values, sizeof own->values);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    memcpy(&((instance *)c)->values, FMUstate, sizeof(fmu_values));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    (void)c;
    free(*FMUstate);
    *FMUstate = 0;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    (void)c;
    (void)FMUstate;
    *size = sizeof(fmu_values);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte bytes[], size_t size)
{
    if (size < sizeof(fmu_values)) {
        return refuse((instance *)c, "a state needs more bytes");
    }
    memcpy(bytes, FMUstate, sizeof(fmu_values));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *FMUstate)
{
    if (size != sizeof(fmu_values) || memcmp(bytes, FMU_TOKEN, sizeof FMU_TOKEN) != 0) {
        return refuse((instance *)c, "these bytes are no state of this model");
    }
    *FMUstate = malloc(size);
    if (!*FMUstate) {
        return refuse((instance *)c, "no memory for a state");
    }
    memcpy(*FMUstate, bytes, size);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    instance *own = (instance *)c;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (own->values.phase != FMU_STEP) {
        return refuse(own, "this function may not be called now");
    }
    return answer(own, fmu_step(&own->values, currentCommunicationPoint, communicationStepSize));
}

/* What the description does not offer. */
#define NOT_OFFERED(name, ...)                                              \
    fmi2Status name(fmi2Component c, __VA_ARGS__)                           \
    {                                                                       \
        return refuse((instance *)c, "this function is not offered");       \
    }
#define NOT_OFFERED_ALONE(name)                                             \
    fmi2Status name(fmi2Component c)                                        \
    {                                                                       \
        return refuse((instance *)c, "this function is not offered");       \
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
