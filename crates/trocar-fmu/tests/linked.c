/* Two FMUs with source code in one program, driven by position: linked TOKEN TOKEN MOTION
 *
 * Runs both along MOTION (CSV, time_s and position_m first), in turn, and prints both forces per line. Compiled with
 * FMI, the version, and FIRST and SECOND, the model identifiers, with which the names of their functions begin. */
#include <stdio.h>
#include <stdlib.h>

#define PASTE(a, b) a##b
#define OF(unit, name) PASTE(unit, name)

static void done(int status) {
    if (status != 0) exit(1);
}

#if FMI == 2
#include "fmi2FunctionTypes.h"
static const fmi2CallbackFunctions callbacks = {NULL, NULL, NULL, NULL, NULL};
#define UNIT(unit)                                                                                                     \
    fmi2InstantiateTYPE OF(unit, _fmi2Instantiate);                                                                    \
    fmi2SetupExperimentTYPE OF(unit, _fmi2SetupExperiment);                                                            \
    fmi2EnterInitializationModeTYPE OF(unit, _fmi2EnterInitializationMode);                                            \
    fmi2ExitInitializationModeTYPE OF(unit, _fmi2ExitInitializationMode);                                              \
    fmi2SetRealTYPE OF(unit, _fmi2SetReal);                                                                            \
    fmi2GetRealTYPE OF(unit, _fmi2GetReal);                                                                            \
    fmi2DoStepTYPE OF(unit, _fmi2DoStep);                                                                              \
    fmi2FreeInstanceTYPE OF(unit, _fmi2FreeInstance);                                                                  \
    static void *OF(unit, _start)(const char *token, double time, double position) {                                   \
        const fmi2ValueReference input = 1;                                                                            \
        fmi2Component c = OF(unit, _fmi2Instantiate)("seal", fmi2CoSimulation, token, "", &callbacks, 0, 0);           \
        done(!c);                                                                                                      \
        done(OF(unit, _fmi2SetupExperiment)(c, 0, 0.0, time, 0, 0.0));                                                 \
        done(OF(unit, _fmi2EnterInitializationMode)(c));                                                               \
        done(OF(unit, _fmi2SetReal)(c, &input, 1, &position));                                                         \
        done(OF(unit, _fmi2ExitInitializationMode)(c));                                                                \
        return c;                                                                                                      \
    }                                                                                                                  \
    static double OF(unit, _advance)(void *c, double time, double duration, double position) {                         \
        const fmi2ValueReference input = 1, force = 2;                                                                 \
        double value;                                                                                                  \
        done(OF(unit, _fmi2SetReal)(c, &input, 1, &position));                                                         \
        if (duration > 0.0) done(OF(unit, _fmi2DoStep)(c, time, duration, 1));                                         \
        done(OF(unit, _fmi2GetReal)(c, &force, 1, &value));                                                            \
        return value;                                                                                                  \
    }                                                                                                                  \
    static void OF(unit, _end)(void *c) { OF(unit, _fmi2FreeInstance)(c); }
#else
#include "fmi3FunctionTypes.h"
#define UNIT(unit)                                                                                                     \
    fmi3InstantiateCoSimulationTYPE OF(unit, _fmi3InstantiateCoSimulation);                                            \
    fmi3EnterInitializationModeTYPE OF(unit, _fmi3EnterInitializationMode);                                            \
    fmi3ExitInitializationModeTYPE OF(unit, _fmi3ExitInitializationMode);                                              \
    fmi3SetFloat64TYPE OF(unit, _fmi3SetFloat64);                                                                      \
    fmi3GetFloat64TYPE OF(unit, _fmi3GetFloat64);                                                                      \
    fmi3DoStepTYPE OF(unit, _fmi3DoStep);                                                                              \
    fmi3FreeInstanceTYPE OF(unit, _fmi3FreeInstance);                                                                  \
    static void *OF(unit, _start)(const char *token, double time, double position) {                                   \
        const fmi3ValueReference input = 1;                                                                            \
        fmi3Instance c = OF(unit, _fmi3InstantiateCoSimulation)("seal", token, "", false, false, false, false, NULL,   \
                                                                0, NULL, NULL, NULL);                                  \
        done(!c);                                                                                                      \
        done(OF(unit, _fmi3EnterInitializationMode)(c, false, 0.0, time, false, 0.0));                                 \
        done(OF(unit, _fmi3SetFloat64)(c, &input, 1, &position, 1));                                                   \
        done(OF(unit, _fmi3ExitInitializationMode)(c));                                                                \
        return c;                                                                                                      \
    }                                                                                                                  \
    static double OF(unit, _advance)(void *c, double time, double duration, double position) {                         \
        const fmi3ValueReference input = 1, force = 2;                                                                 \
        bool event, end, early;                                                                                        \
        double value, last;                                                                                            \
        done(OF(unit, _fmi3SetFloat64)(c, &input, 1, &position, 1));                                                   \
        if (duration > 0.0) done(OF(unit, _fmi3DoStep)(c, time, duration, true, &event, &end, &early, &last));         \
        done(OF(unit, _fmi3GetFloat64)(c, &force, 1, &value, 1));                                                      \
        return value;                                                                                                  \
    }                                                                                                                  \
    static void OF(unit, _end)(void *c) { OF(unit, _fmi3FreeInstance)(c); }
#endif

UNIT(FIRST)
UNIT(SECOND)

int main(int count, char **arguments) {
    FILE *motion = count == 4 ? fopen(arguments[3], "r") : NULL;
    void *first, *second;
    double time, position, before;
    if (!motion || fscanf(motion, "%*[^\n]") != 0 || fscanf(motion, "%lf,%lf", &time, &position) != 2) return 2;
    first = OF(FIRST, _start)(arguments[1], time, position);
    second = OF(SECOND, _start)(arguments[2], time, position);
    before = time;
    do {
        printf("%.17g ", OF(FIRST, _advance)(first, before, time - before, position));
        printf("%.17g\n", OF(SECOND, _advance)(second, before, time - before, position));
        before = time;
    } while (fscanf(motion, "%lf,%lf", &time, &position) == 2);
    OF(FIRST, _end)(first);
    OF(SECOND, _end)(second);
    return fclose(motion);
}
