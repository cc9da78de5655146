/* Runs an exported model (model.h in the include path) along a motion: exported MOTION.csv prints one force per row. */
#include <stdio.h>

#include "model.h"

int main(int argc, char **argv) {
    FILE *motion = argc == 2 ? fopen(argv[1], "r") : NULL;
    double time = 0.0, position = 0.0, before = 0.0;
    trocar_state state;
    if (!motion || fscanf(motion, "%*[^\n]") != 0 || fscanf(motion, "%lf,%lf", &before, &position) != 2) {
        fprintf(stderr, "expected MOTION.csv with time_s,position_m\n");
        return 1;
    }
    trocar_rest(&state, position);
    printf("%.17g\n", state.force_n);
    while (fscanf(motion, "%lf,%lf", &time, &position) == 2) {
        printf("%.17g\n", trocar_step_to(&state, position, time - before));
        before = time;
    }
    return fclose(motion);
}
