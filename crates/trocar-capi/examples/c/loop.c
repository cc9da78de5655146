/* A control loop at 1 kHz: reads an encoder, gives the force of the trocar. Usage: loop [MODEL.json] */
#include <stdio.h>

#include <trocar.h>

/* Stands for an encoder: insertion by 40 mm in a second, then 1 s of hold. */
static double encoder_m(int tick)
{
    return 0.1 + (tick < 1000 ? 40e-6 * tick : 0.04);
}

int main(int argc, char **argv)
{
    char message[TROCAR_MESSAGE_SIZE] = "";
    trocar_model *model = NULL;
    trocar_state seal;
    trocar_status status;
    double force_n = 0.0;
    int tick;

    status = argc > 1 ? trocar_model_load(argv[1], &model, message, sizeof message) : trocar_model_plausible(&model);
    if (status != TROCAR_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", trocar_status_message(status), message);
        return 1;
    }
    trocar_state_init(model, &seal, encoder_m(0));
    for (tick = 1; tick <= 2000; tick++) {
        /* Here a real loop waits for its next millisecond. */
        status = trocar_step_to(model, &seal, encoder_m(tick), 1e-3, &force_n);
        if (status != TROCAR_STATUS_OK) {
            fprintf(stderr, "tick %d: %s\n", tick, trocar_status_message(status));
        }
        /* A haptic device renders -force_n: what the instrument feels. */
        if (tick % 500 == 0) {
            printf("%4d ms  %6.1f mm  %7.3f N\n", tick, 1e3 * encoder_m(tick), force_n);
        }
    }
    trocar_model_free(model);
    return 0;
}
