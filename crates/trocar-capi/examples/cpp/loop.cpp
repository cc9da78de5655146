// A control loop at 1 kHz: reads an encoder, gives the force of the trocar. Usage: loop [MODEL.json]
#include <cstdio>

#include <trocar.hpp>

// Stands for an encoder: insertion by 40 mm in a second, then 1 s of hold.
static double encoder_m(int tick) { return 0.1 + (tick < 1000 ? 40e-6 * tick : 0.04); }

int main(int argc, char **argv) try {
    const trocar::Model model = argc > 1 ? trocar::Model::load(argv[1]) : trocar::Model::plausible();
    trocar::State seal(model, encoder_m(0));
    for (int tick = 1; tick <= 2000; ++tick) {
        // Here a real loop waits for its next millisecond.
        const trocar::Step step = seal.step_to(encoder_m(tick), 1e-3);
        if (!step) {
            std::fprintf(stderr, "tick %d: %s\n", tick, trocar::message(step.status));
        }
        // A haptic device renders -force_n: what the instrument feels.
        if (tick % 500 == 0) {
            std::printf("%4d ms  %6.1f mm  %7.3f N\n", tick, 1e3 * encoder_m(tick), step.force_n);
        }
    }
    return 0;
} catch (const trocar::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
