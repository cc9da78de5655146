/* An importer in C, against the headers of the standard: importer LIBRARY 2|3 RESOURCES TOKEN MOTION
 *
 * Runs an FMU driven by position along MOTION (CSV, time_s and position_m first) and prints one force per line; half way
 * the state goes through its bytes into a second instance. Then does what the FMU must refuse and prints what it says
 * to standard error. RESOURCES is a URI for 2 and a path for 3. Built by check.py with sanitizers, by foreign.py for
 * other platforms. */
#ifdef _WIN32
/* Without windows, whose INPUT is another one. */
#define WIN32_LEAN_AND_MEAN
#define NOUSER
#include <windows.h>
#else
#include <dlfcn.h>
#endif
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

enum { INPUT = 1, FORCE = 2, MODE = 4, ROWS = 100000 };

#ifdef _WIN32
static HMODULE library;

static void open_library(const char *path) {
    library = LoadLibraryA(path);
    if (!library) fprintf(stderr, "%s: error %lu\n", path, GetLastError());
}

static void *symbol(const char *name) {
    return (void *)GetProcAddress(library, name);
}
#else
static void *library;

static void open_library(const char *path) {
    library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) fprintf(stderr, "%s\n", dlerror());
}

static void *symbol(const char *name) {
    return dlsym(library, name);
}
#endif

static double times[ROWS], positions[ROWS];
static int rows;

static void *function(const char *name) {
    void *found = symbol(name);
    if (!found) {
        fprintf(stderr, "no function %s\n", name);
        exit(1);
    }
    return found;
}

#define LOAD(name) name##TYPE *name = (name##TYPE *)function(#name)
#define DO(call)                                                                                                       \
    do {                                                                                                               \
        if ((call) != 0) {                                                                                             \
            fprintf(stderr, "failed: %s\n", #call);                                                                    \
            exit(1);                                                                                                   \
        }                                                                                                              \
    } while (0)
/* Refused, with one message. */
#define REFUSE(call) refuse((call) == 3, 1, #call)
#define REFUSE_START(call) refuse(!(call), 1, #call)
/* The instance holds the logger: without one there is no logger to report it to. */
#define REFUSE_SILENTLY(call) refuse((call) == 3, 0, #call)

static int messages, messages_before;

static void refuse(int refused, int expected, const char *call) {
    if (!refused || messages - messages_before != expected) {
        fprintf(stderr, "%s: %s, %d messages\n", call, refused ? "refused" : "not refused", messages - messages_before);
        exit(1);
    }
    messages_before = messages;
}

static void log2_(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String kind, fmi2String text, ...) {
    va_list rest;
    (void)e;
    messages++;
    fprintf(stderr, "%s %d %s: ", name, (int)status, kind);
    va_start(rest, text);
    vfprintf(stderr, text, rest);
    va_end(rest);
    fputc('\n', stderr);
}

static void log3_(fmi3InstanceEnvironment e, fmi3Status status, fmi3String kind, fmi3String text) {
    (void)e;
    messages++;
    fprintf(stderr, "%d %s: %s\n", (int)status, kind, text);
}

static void read_motion(const char *path) {
    FILE *file = fopen(path, "r");
    char line[256], *comma;
    if (!file || !fgets(line, sizeof line, file)) exit(1);
    /* Not scanf: that of mingw is wrong in the last bit of some numbers. */
    for (; rows < ROWS && fgets(line, sizeof line, file); rows++) {
        times[rows] = strtod(line, &comma);
        if (*comma != ',') exit(1);
        positions[rows] = strtod(comma + 1, NULL);
    }
    fclose(file);
}

static void refuse_null_pointers2(fmi2Component c) {
    LOAD(fmi2SetDebugLogging); LOAD(fmi2SetupExperiment); LOAD(fmi2EnterInitializationMode); LOAD(fmi2Terminate);
    LOAD(fmi2Reset); LOAD(fmi2GetReal); LOAD(fmi2SetReal); LOAD(fmi2GetInteger); LOAD(fmi2GetString); LOAD(fmi2DoStep);
    LOAD(fmi2GetFMUstate); LOAD(fmi2SetFMUstate); LOAD(fmi2FreeFMUstate); LOAD(fmi2SerializedFMUstateSize);
    LOAD(fmi2SerializeFMUstate); LOAD(fmi2DeSerializeFMUstate); LOAD(fmi2CancelStep);
    const fmi2ValueReference input = INPUT, mode = MODE;
    fmi2FMUstate state = NULL, copy = NULL;
    size_t size;
    fmi2Byte *bytes;
    double value = 0.0;
    int integer;
    DO(fmi2GetFMUstate(c, &state));
    DO(fmi2SerializedFMUstateSize(c, state, &size));
    bytes = malloc(size);
    DO(fmi2SerializeFMUstate(c, state, bytes, size));
    REFUSE(fmi2SetDebugLogging(c, 1, 1, NULL));
    REFUSE(fmi2GetReal(c, NULL, 1, &value));
    REFUSE(fmi2GetReal(c, &input, 1, NULL));
    REFUSE(fmi2SetReal(c, NULL, 1, &value));
    REFUSE(fmi2SetReal(c, &input, 1, NULL));
    REFUSE(fmi2GetInteger(c, NULL, 1, &integer));
    REFUSE(fmi2GetInteger(c, &mode, 1, NULL));
    REFUSE(fmi2GetString(c, NULL, 1, NULL));
    REFUSE(fmi2GetFMUstate(c, NULL));
    REFUSE(fmi2SetFMUstate(c, NULL));
    REFUSE(fmi2SerializedFMUstateSize(c, NULL, &size));
    REFUSE(fmi2SerializedFMUstateSize(c, state, NULL));
    REFUSE(fmi2SerializeFMUstate(c, NULL, bytes, size));
    REFUSE(fmi2SerializeFMUstate(c, state, NULL, size));
    REFUSE(fmi2DeSerializeFMUstate(c, NULL, size, &copy));
    REFUSE(fmi2DeSerializeFMUstate(c, bytes, size, NULL));
    DO(fmi2FreeFMUstate(c, NULL));
    DO(fmi2FreeFMUstate(c, &copy));
    DO(fmi2GetReal(c, NULL, 0, NULL));
    REFUSE_SILENTLY(fmi2SetDebugLogging(NULL, 1, 0, NULL));
    REFUSE_SILENTLY(fmi2SetupExperiment(NULL, 0, 0.0, 0.0, 0, 0.0));
    REFUSE_SILENTLY(fmi2EnterInitializationMode(NULL));
    REFUSE_SILENTLY(fmi2Terminate(NULL));
    REFUSE_SILENTLY(fmi2Reset(NULL));
    REFUSE_SILENTLY(fmi2GetReal(NULL, &input, 1, &value));
    REFUSE_SILENTLY(fmi2SetReal(NULL, &input, 1, &value));
    REFUSE_SILENTLY(fmi2GetInteger(NULL, &mode, 1, &integer));
    REFUSE_SILENTLY(fmi2GetString(NULL, &mode, 1, NULL));
    REFUSE_SILENTLY(fmi2GetFMUstate(NULL, &copy));
    REFUSE_SILENTLY(fmi2SetFMUstate(NULL, state));
    REFUSE_SILENTLY(fmi2SerializedFMUstateSize(NULL, state, &size));
    REFUSE_SILENTLY(fmi2SerializeFMUstate(NULL, state, bytes, size));
    REFUSE_SILENTLY(fmi2DeSerializeFMUstate(NULL, bytes, size, &copy));
    REFUSE_SILENTLY(fmi2DoStep(NULL, 0.0, 1e-3, 1));
    REFUSE_SILENTLY(fmi2CancelStep(NULL));
    DO(fmi2FreeFMUstate(c, &state));
    free(bytes);
}

static void refuse_instances2(const char *resources, const char *token) {
    LOAD(fmi2Instantiate); LOAD(fmi2FreeInstance);
    const fmi2CallbackFunctions callbacks = {log2_, NULL, NULL, NULL, NULL}, silent = {NULL, NULL, NULL, NULL, NULL};
    const char *nowhere = "file:///no%20such%25/folder";
    REFUSE_START(fmi2Instantiate("100% #r1#", fmi2CoSimulation, "wrong", nowhere, &callbacks, 0, 0));
    REFUSE_START(fmi2Instantiate("first", fmi2ModelExchange, token, resources, &callbacks, 0, 0));
    REFUSE_START(fmi2Instantiate("first", fmi2CoSimulation, NULL, resources, &callbacks, 0, 0));
    REFUSE_START(fmi2Instantiate(NULL, fmi2CoSimulation, token, resources, &callbacks, 0, 0));
    if (fmi2Instantiate("first", fmi2CoSimulation, token, resources, NULL, 0, 0)) exit(1);
    if (fmi2Instantiate("first", fmi2CoSimulation, "wrong", resources, &silent, 0, 0)) exit(1);
    fmi2FreeInstance(NULL);
}

/* Sets up and initializes; before, between and after that, calls that do not belong there. */
static void initialize2(fmi2Component c) {
    LOAD(fmi2SetupExperiment); LOAD(fmi2EnterInitializationMode); LOAD(fmi2ExitInitializationMode); LOAD(fmi2SetReal);
    LOAD(fmi2DoStep); LOAD(fmi2Terminate);
    const fmi2ValueReference input = INPUT;
    const double end = times[rows - 1];
    REFUSE(fmi2ExitInitializationMode(c));
    REFUSE(fmi2DoStep(c, times[0], 1e-3, 1));
    REFUSE(fmi2Terminate(c));
    REFUSE(fmi2SetupExperiment(c, 0, 0.0, 0.0 / 0.0, 0, 0.0));
    REFUSE(fmi2SetupExperiment(c, 0, 0.0, times[0], 1, times[0]));
    REFUSE(fmi2SetupExperiment(c, 0, 0.0, times[0], 1, 0.0 / 0.0));
    DO(fmi2SetupExperiment(c, 0, 0.0, times[0], 1, end));
    DO(fmi2EnterInitializationMode(c));
    REFUSE(fmi2SetupExperiment(c, 0, 0.0, times[0], 1, end));
    REFUSE(fmi2EnterInitializationMode(c));
    REFUSE(fmi2DoStep(c, times[0], 1e-3, 1));
    DO(fmi2SetReal(c, &input, 1, &positions[0]));
    DO(fmi2ExitInitializationMode(c));
    REFUSE(fmi2ExitInitializationMode(c));
    REFUSE(fmi2SetupExperiment(c, 0, 0.0, times[0], 1, end));
}

/* Steps from the last row, and functions for what is not offered. */
static void refuse_steps2(fmi2Component c) {
    LOAD(fmi2DoStep); LOAD(fmi2CancelStep); LOAD(fmi2GetDirectionalDerivative); LOAD(fmi2SetRealInputDerivatives);
    LOAD(fmi2GetRealOutputDerivatives);
    const fmi2ValueReference input = INPUT, force = FORCE;
    const double end = times[rows - 1];
    const int first = 1;
    double value = 1.0, derivative;
    REFUSE(fmi2DoStep(c, end, 0.0, 1));
    REFUSE(fmi2DoStep(c, end, -1e-3, 1));
    REFUSE(fmi2DoStep(c, end - 1.0, 1e-3, 1));
    REFUSE(fmi2DoStep(c, end, 1e-3, 1));
    REFUSE(fmi2CancelStep(c));
    REFUSE(fmi2GetDirectionalDerivative(c, &force, 1, &input, 1, &value, &derivative));
    REFUSE(fmi2SetRealInputDerivatives(c, &input, 1, &first, &value));
    REFUSE(fmi2GetRealOutputDerivatives(c, &force, 1, &first, &derivative));
}

static void run2(const char *resources, const char *token) {
    LOAD(fmi2Instantiate); LOAD(fmi2FreeInstance); LOAD(fmi2SetReal); LOAD(fmi2GetReal); LOAD(fmi2DoStep); LOAD(fmi2GetFMUstate);
    LOAD(fmi2FreeFMUstate); LOAD(fmi2SerializedFMUstateSize); LOAD(fmi2SerializeFMUstate);
    LOAD(fmi2DeSerializeFMUstate); LOAD(fmi2SetFMUstate); LOAD(fmi2GetVersion); LOAD(fmi2Terminate);
    const fmi2CallbackFunctions callbacks = {log2_, NULL, NULL, NULL, NULL};
    const fmi2ValueReference input = INPUT, force = FORCE, none = 77;
    fmi2Component c = fmi2Instantiate("first", fmi2CoSimulation, token, resources, &callbacks, 0, 0), other;
    fmi2FMUstate state = NULL, copy = NULL;
    size_t size;
    fmi2Byte *bytes;
    double value, step;
    if (!c || strcmp(fmi2GetVersion(), "2.0") != 0) exit(1);
    initialize2(c);
    for (int k = 0; k < rows; k++) {
        step = k ? times[k] - times[k - 1] : 0.0;
        if (step > 0.0) {
            DO(fmi2SetReal(c, &input, 1, &positions[k]));
            DO(fmi2DoStep(c, times[k - 1], step, 1));
        }
        DO(fmi2GetReal(c, &force, 1, &value));
        printf("%.17g\n", value);
        if (k == rows / 2) {
            DO(fmi2GetFMUstate(c, &state));
            DO(fmi2GetFMUstate(c, &state));
            DO(fmi2SerializedFMUstateSize(c, state, &size));
            bytes = malloc(size);
            DO(fmi2SerializeFMUstate(c, state, bytes, size));
            other = fmi2Instantiate("second", fmi2CoSimulation, token, resources, &callbacks, 0, 0);
            REFUSE(fmi2DeSerializeFMUstate(other, bytes, size - 1, &copy));
            DO(fmi2DeSerializeFMUstate(other, bytes, size, &copy));
            DO(fmi2SetFMUstate(other, copy));
            DO(fmi2FreeFMUstate(other, &copy));
            DO(fmi2FreeFMUstate(c, &state));
            free(bytes);
            fmi2FreeInstance(c);
            c = other;
        }
    }
    value = 0.0 / 0.0;
    REFUSE(fmi2SetReal(c, &input, 1, &value));
    REFUSE(fmi2SetReal(c, &none, 1, &value));
    refuse_steps2(c);
    refuse_null_pointers2(c);
    refuse_instances2(resources, token);
    DO(fmi2Terminate(c));
    REFUSE(fmi2DoStep(c, times[rows - 1], 1e-3, 1));
    REFUSE(fmi2SetReal(c, &input, 1, &positions[0]));
    fmi2FreeInstance(c);
}

static void refuse_null_pointers3(fmi3Instance c) {
    LOAD(fmi3SetDebugLogging); LOAD(fmi3EnterInitializationMode); LOAD(fmi3Terminate); LOAD(fmi3Reset); LOAD(fmi3DoStep);
    LOAD(fmi3GetFloat64); LOAD(fmi3SetFloat64); LOAD(fmi3GetInt64); LOAD(fmi3GetString); LOAD(fmi3GetFMUState);
    LOAD(fmi3SetFMUState); LOAD(fmi3FreeFMUState); LOAD(fmi3SerializedFMUStateSize); LOAD(fmi3SerializeFMUState);
    LOAD(fmi3DeserializeFMUState); LOAD(fmi3EnterEventMode);
    const fmi3ValueReference input = INPUT, mode = MODE;
    fmi3FMUState state = NULL, copy = NULL;
    size_t size;
    fmi3Byte *bytes;
    double value = 0.0, last;
    fmi3Int64 integer;
    bool event, end, early;
    DO(fmi3GetFMUState(c, &state));
    DO(fmi3SerializedFMUStateSize(c, state, &size));
    bytes = malloc(size);
    DO(fmi3SerializeFMUState(c, state, bytes, size));
    REFUSE(fmi3SetDebugLogging(c, true, 1, NULL));
    REFUSE(fmi3GetFloat64(c, NULL, 1, &value, 1));
    REFUSE(fmi3GetFloat64(c, &input, 1, NULL, 1));
    REFUSE(fmi3GetFloat64(c, &input, 1, &value, 0));
    REFUSE(fmi3SetFloat64(c, NULL, 1, &value, 1));
    REFUSE(fmi3SetFloat64(c, &input, 1, NULL, 1));
    REFUSE(fmi3GetInt64(c, NULL, 1, &integer, 1));
    REFUSE(fmi3GetInt64(c, &mode, 1, NULL, 1));
    REFUSE(fmi3GetString(c, NULL, 1, NULL, 1));
    REFUSE(fmi3DoStep(c, 0.0, 1e-3, true, NULL, &end, &early, &last));
    REFUSE(fmi3DoStep(c, 0.0, 1e-3, true, &event, NULL, &early, &last));
    REFUSE(fmi3DoStep(c, 0.0, 1e-3, true, &event, &end, NULL, &last));
    REFUSE(fmi3DoStep(c, 0.0, 1e-3, true, &event, &end, &early, NULL));
    REFUSE(fmi3GetFMUState(c, NULL));
    REFUSE(fmi3SetFMUState(c, NULL));
    REFUSE(fmi3SerializedFMUStateSize(c, NULL, &size));
    REFUSE(fmi3SerializedFMUStateSize(c, state, NULL));
    REFUSE(fmi3SerializeFMUState(c, NULL, bytes, size));
    REFUSE(fmi3SerializeFMUState(c, state, NULL, size));
    REFUSE(fmi3DeserializeFMUState(c, NULL, size, &copy));
    REFUSE(fmi3DeserializeFMUState(c, bytes, size, NULL));
    DO(fmi3FreeFMUState(c, NULL));
    DO(fmi3FreeFMUState(c, &copy));
    DO(fmi3GetFloat64(c, NULL, 0, NULL, 0));
    REFUSE_SILENTLY(fmi3SetDebugLogging(NULL, true, 0, NULL));
    REFUSE_SILENTLY(fmi3EnterInitializationMode(NULL, false, 0.0, 0.0, false, 0.0));
    REFUSE_SILENTLY(fmi3Terminate(NULL));
    REFUSE_SILENTLY(fmi3Reset(NULL));
    REFUSE_SILENTLY(fmi3GetFloat64(NULL, &input, 1, &value, 1));
    REFUSE_SILENTLY(fmi3SetFloat64(NULL, &input, 1, &value, 1));
    REFUSE_SILENTLY(fmi3GetInt64(NULL, &mode, 1, &integer, 1));
    REFUSE_SILENTLY(fmi3GetString(NULL, &mode, 1, NULL, 1));
    REFUSE_SILENTLY(fmi3DoStep(NULL, 0.0, 1e-3, true, &event, &end, &early, &last));
    REFUSE_SILENTLY(fmi3GetFMUState(NULL, &copy));
    REFUSE_SILENTLY(fmi3SetFMUState(NULL, state));
    REFUSE_SILENTLY(fmi3SerializedFMUStateSize(NULL, state, &size));
    REFUSE_SILENTLY(fmi3SerializeFMUState(NULL, state, bytes, size));
    REFUSE_SILENTLY(fmi3DeserializeFMUState(NULL, bytes, size, &copy));
    REFUSE_SILENTLY(fmi3EnterEventMode(NULL));
    DO(fmi3FreeFMUState(c, &state));
    free(bytes);
}

static fmi3Instance start3(const char *name, const char *token, const char *resources, bool event_mode,
                           fmi3LogMessageCallback log) {
    LOAD(fmi3InstantiateCoSimulation);
    const fmi3ValueReference force = FORCE;
    return fmi3InstantiateCoSimulation(name, token, resources, false, false, event_mode, true, &force, 1, NULL, log, NULL);
}

static void refuse_instances3(const char *resources, const char *token) {
    LOAD(fmi3InstantiateModelExchange); LOAD(fmi3InstantiateScheduledExecution); LOAD(fmi3FreeInstance);
    REFUSE_START(start3("third", "wrong", "/no such/folder/", false, log3_));
    REFUSE_START(start3("third", token, resources, true, log3_));
    REFUSE_START(start3("third", NULL, resources, false, log3_));
    REFUSE_START(start3(NULL, token, resources, false, log3_));
    REFUSE_START(fmi3InstantiateModelExchange("third", token, resources, false, false, NULL, log3_));
    REFUSE_START(fmi3InstantiateScheduledExecution("third", token, resources, false, false, NULL, log3_, NULL, NULL, NULL));
    if (start3("third", "wrong", resources, false, NULL)) exit(1);
    fmi3FreeInstance(NULL);
}

/* Initializes; before and after that, calls that do not belong there. */
static void initialize3(fmi3Instance c) {
    LOAD(fmi3EnterInitializationMode); LOAD(fmi3ExitInitializationMode); LOAD(fmi3SetFloat64); LOAD(fmi3DoStep);
    LOAD(fmi3Terminate);
    const fmi3ValueReference input = INPUT;
    const double end = times[rows - 1];
    bool event, stop, early;
    double last;
    REFUSE(fmi3ExitInitializationMode(c));
    REFUSE(fmi3DoStep(c, times[0], 1e-3, true, &event, &stop, &early, &last));
    REFUSE(fmi3Terminate(c));
    REFUSE(fmi3EnterInitializationMode(c, false, 0.0, 0.0 / 0.0, false, 0.0));
    REFUSE(fmi3EnterInitializationMode(c, false, 0.0, times[0], true, times[0]));
    REFUSE(fmi3EnterInitializationMode(c, false, 0.0, times[0], true, 0.0 / 0.0));
    DO(fmi3EnterInitializationMode(c, false, 0.0, times[0], true, end));
    REFUSE(fmi3EnterInitializationMode(c, false, 0.0, times[0], true, end));
    REFUSE(fmi3DoStep(c, times[0], 1e-3, true, &event, &stop, &early, &last));
    DO(fmi3SetFloat64(c, &input, 1, &positions[0], 1));
    DO(fmi3ExitInitializationMode(c));
    REFUSE(fmi3ExitInitializationMode(c));
}

/* Steps from the last row, and functions for what is not offered. */
static void refuse_steps3(fmi3Instance c) {
    LOAD(fmi3DoStep); LOAD(fmi3EnterEventMode); LOAD(fmi3GetBinary); LOAD(fmi3GetClock); LOAD(fmi3SetClock);
    LOAD(fmi3GetDirectionalDerivative); LOAD(fmi3GetAdjointDerivative); LOAD(fmi3GetOutputDerivatives);
    const fmi3ValueReference input = INPUT, force = FORCE;
    const double now = times[rows - 1];
    const fmi3Int32 first = 1;
    bool event, end, early, clock = false;
    double value = 1.0, derivative, last;
    REFUSE(fmi3DoStep(c, now, 0.0, true, &event, &end, &early, &last));
    REFUSE(fmi3DoStep(c, now, -1.0, true, &event, &end, &early, &last));
    REFUSE(fmi3DoStep(c, now - 1.0, 1e-3, true, &event, &end, &early, &last));
    REFUSE(fmi3DoStep(c, now, 1e-3, true, &event, &end, &early, &last));
    REFUSE(fmi3EnterEventMode(c));
    REFUSE(fmi3GetBinary(c, &force, 1, NULL, NULL, 0));
    REFUSE(fmi3GetClock(c, &force, 1, &clock));
    REFUSE(fmi3SetClock(c, &input, 1, &clock));
    REFUSE(fmi3GetDirectionalDerivative(c, &force, 1, &input, 1, &value, 1, &derivative, 1));
    REFUSE(fmi3GetAdjointDerivative(c, &force, 1, &input, 1, &value, 1, &derivative, 1));
    REFUSE(fmi3GetOutputDerivatives(c, &force, 1, &first, &derivative, 1));
}

static void run3(const char *resources, const char *token) {
    LOAD(fmi3FreeInstance); LOAD(fmi3SetFloat64); LOAD(fmi3GetFloat64); LOAD(fmi3DoStep);
    LOAD(fmi3GetFMUState); LOAD(fmi3FreeFMUState); LOAD(fmi3SerializedFMUStateSize); LOAD(fmi3SerializeFMUState);
    LOAD(fmi3DeserializeFMUState); LOAD(fmi3SetFMUState); LOAD(fmi3GetVersion); LOAD(fmi3Terminate);
    const fmi3ValueReference input = INPUT, force = FORCE, none = 77;
    fmi3Instance c, other;
    fmi3FMUState state = NULL, copy = NULL;
    size_t size;
    fmi3Byte *bytes;
    bool event = true, end = true, early = true;
    double value, step, last = -1.0;
    c = start3("first", token, resources, false, log3_);
    if (!c || strcmp(fmi3GetVersion(), "3.0") != 0) exit(1);
    initialize3(c);
    for (int k = 0; k < rows; k++) {
        step = k ? times[k] - times[k - 1] : 0.0;
        if (step > 0.0) {
            DO(fmi3SetFloat64(c, &input, 1, &positions[k], 1));
            DO(fmi3DoStep(c, times[k - 1], step, true, &event, &end, &early, &last));
            if (event || end || early || last != times[k - 1] + step) exit(1);
        }
        DO(fmi3GetFloat64(c, &force, 1, &value, 1));
        printf("%.17g\n", value);
        if (k == rows / 2) {
            DO(fmi3GetFMUState(c, &state));
            DO(fmi3SerializedFMUStateSize(c, state, &size));
            bytes = malloc(size);
            DO(fmi3SerializeFMUState(c, state, bytes, size));
            other = start3("second", token, resources, false, log3_);
            REFUSE(fmi3DeserializeFMUState(other, bytes, size - 1, &copy));
            DO(fmi3DeserializeFMUState(other, bytes, size, &copy));
            DO(fmi3SetFMUState(other, copy));
            DO(fmi3FreeFMUState(other, &copy));
            DO(fmi3FreeFMUState(c, &state));
            free(bytes);
            fmi3FreeInstance(c);
            c = other;
        }
    }
    value = 0.0 / 0.0;
    REFUSE(fmi3SetFloat64(c, &input, 1, &value, 1));
    REFUSE(fmi3SetFloat64(c, &none, 1, &value, 1));
    refuse_steps3(c);
    refuse_null_pointers3(c);
    refuse_instances3(resources, token);
    DO(fmi3Terminate(c));
    REFUSE(fmi3DoStep(c, times[rows - 1], 1e-3, true, &event, &end, &early, &last));
    REFUSE(fmi3SetFloat64(c, &input, 1, &positions[0], 1));
    fmi3FreeInstance(c);
}

int main(int count, char **arguments) {
    if (count != 6) return 2;
    open_library(arguments[1]);
    if (!library) return 1;
    read_motion(arguments[5]);
    (arguments[2][0] == '2' ? run2 : run3)(arguments[3], arguments[4]);
    return 0;
}
