// How long one compensated sample takes: by trocar::Compensator directly, and by the library of this package, which also
// joins two topics. Strokes at 1 kHz with a reading as rough as a sensor's; median, 99.9 %, worst.
// Usage: latency MODEL.json [SAMPLES [FORCE_ERROR_N]]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include <trocar_ros/tissue_force.hpp>

#include "motion.hpp"

namespace {

using Clock = std::chrono::steady_clock;

struct Input {
    double position_m;
    double reading_n;
};

/** Times of work(tick) for each tick, ns, sorted. */
template <typename Work> std::vector<double> timed(std::size_t samples, Work work) {
    std::vector<double> times(samples);
    for (std::size_t tick = 0; tick < samples; ++tick) {
        const Clock::time_point start = Clock::now();
        work(tick);
        times[tick] = std::chrono::duration<double, std::nano>(Clock::now() - start).count();
    }
    std::sort(times.begin(), times.end());
    return times;
}

void print(const char *name, const std::vector<double> &times) {
    const auto part = [&](double share) { return times[static_cast<std::size_t>(share * double(times.size() - 1))]; };
    std::printf("| %s | %.2f | %.2f | %.1f |\n", name, part(0.5) / 1e3, part(0.999) / 1e3, times.back() / 1e3);
}

} // namespace

int main(int argc, char **argv) try {
    if (argc < 2 || argc > 4) {
        std::fprintf(stderr, "usage: latency MODEL.json [SAMPLES [FORCE_ERROR_N]]\n");
        return 2;
    }
    const long given = argc > 2 ? std::atol(argv[2]) : 1'000'000;
    if (given < 1) {
        std::fprintf(stderr, "SAMPLES must be 1 or more, got %s\n", argv[2]);
        return 2;
    }
    const auto samples = static_cast<std::size_t>(given);
    const trocar::Model model = trocar::Model::load(argv[1]);
    trocar_ros::Settings settings;
    if (argc > 3) {
        settings.compensator.force_error_n = std::atof(argv[3]);
    }
    std::vector<Input> inputs(samples);
    for (std::size_t tick = 0; tick < samples; ++tick) {
        const double time_s = double(tick) * 1e-3;
        inputs[tick] = {motion::position_m(time_s), motion::reading_n(time_s, tick)};
    }

    double sum_n = 0.0; // so that nothing is optimised away
    std::printf("| one sample, µs (%zu at 1 kHz) | median | 99.9 %% | worst |\n|---|---|---|---|\n", samples);
    print("the clock alone", timed(samples, [](std::size_t) {}));

    trocar::Compensator observer(model, settings.compensator);
    print("trocar::Compensator::step", timed(samples, [&](std::size_t tick) {
              sum_n += observer.step(inputs[tick].position_m, inputs[tick].reading_n, 1e-3).trocar_force_n;
          }));

    trocar_ros::TissueForce tissue(model, settings);
    std::size_t done = 0;
    print("trocar_ros::TissueForce, position and reading", timed(samples, [&](std::size_t tick) {
              const auto stamp_ns = static_cast<std::int64_t>(tick) * 1'000'000;
              tissue.add_position(stamp_ns, inputs[tick].position_m);
              tissue.add_reading(stamp_ns, inputs[tick].reading_n);
              while (const auto sample = tissue.next()) {
                  sum_n += sample->estimate.trocar_force_n;
                  ++done;
              }
          }));
    if (done != samples || !(sum_n == sum_n)) {
        std::fprintf(stderr, "%zu samples came of %zu\n", done, samples);
        return 1;
    }
    return 0;
} catch (const trocar::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
