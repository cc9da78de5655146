/* Runs a model that turns along a motion: turning MOTION.csv MODEL.json through the C library where LIBRARY is defined,
 * turning MOTION.csv an exported model (model.h in the include path). Prints a force and a torque per row. */
#include <stdio.h>

#ifdef LIBRARY
#include <trocar.h>
#else
#include "model.h"
#endif

int main(int argc, char **argv) {
    FILE *motion = argc >= 2 ? fopen(argv[1], "r") : NULL;
    double time = 0.0, position = 0.0, angle = 0.0, before = 0.0, force, torque;
    trocar_state state;
    if (!motion || fscanf(motion, "%*[^\n]") != 0 || fscanf(motion, "%lf,%lf,%lf", &before, &position, &angle) != 3 ||
        angle != 0.0) {
        fprintf(stderr, "expected MOTION.csv with time_s,position_m,angle_rad that begins at 0 rad\n");
        return 1;
    }
#ifdef LIBRARY
    trocar_model *model = NULL;
    char message[TROCAR_MESSAGE_SIZE] = "";
    if (argc != 3 || trocar_model_load(argv[2], &model, message, sizeof message) != TROCAR_STATUS_OK ||
        trocar_state_init(model, &state, position) != TROCAR_STATUS_OK) {
        fprintf(stderr, "expected a model: %s\n", message);
        return 1;
    }
    trocar_state_force(&state, &force);
    trocar_state_torque(model, &state, &torque);
#else
    trocar_rest(&state, position);
    force = state.force_n;
    torque = state.torque_n_m;
#endif
    printf("%.17g\n%.17g\n", force, torque);
    while (fscanf(motion, "%lf,%lf,%lf", &time, &position, &angle) == 3) {
#ifdef LIBRARY
        /* A row at the time of the one before is refused and changes nothing. */
        if (time > before && trocar_turn_to(model, &state, position, angle, time - before, &force) != TROCAR_STATUS_OK) {
            fprintf(stderr, "refused at %g s\n", time);
            return 1;
        }
        trocar_state_torque(model, &state, &torque);
#else
        force = trocar_turn_to(&state, position, angle, time - before);
        torque = state.torque_n_m;
#endif
        printf("%.17g\n%.17g\n", force, torque);
        before = time;
    }
#ifdef LIBRARY
    trocar_model_free(model);
#endif
    return fclose(motion);
}
