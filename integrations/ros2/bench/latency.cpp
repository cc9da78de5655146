// How long one compensated sample takes: by trocar::Compensator directly, and by the library of this package, which also
// joins two topics. Strokes at 1 kHz with a reading as rough as a sensor's; median, 99.9 %, worst. The last column is the worst
// of what each sample takes in the fastest of several runs over the same samples: without what interrupts the program.
// Usage: latency MODEL.json [SAMPLES [FORCE_ERROR_N]]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <vector>

#include <trocar_ros/tissue_force.hpp>

#include "motion.hpp"

namespace {

using Clock = std::chrono::steady_clock;

struct Input {
    double position_m;
    double reading_n;
};

constexpr int kRuns = 5;

/** Runs make()'s work over each tick several times, and prints a row. */
template <typename Make> void measure(const char *name, std::size_t samples, Make make) {
    std::vector<double> first(samples);
    std::vector<double> fastest(samples, std::numeric_limits<double>::infinity());
    for (int run = 0; run < kRuns; ++run) {
        auto work = make();
        for (std::size_t tick = 0; tick < samples; ++tick) {
            const Clock::time_point start = Clock::now();
            work(tick);
            const double time_us = std::chrono::duration<double, std::micro>(Clock::now() - start).count();
            first[tick] = run == 0 ? time_us : first[tick];
            fastest[tick] = std::min(fastest[tick], time_us);
        }
    }
    std::sort(first.begin(), first.end());
    const auto part = [&](double share) { return first[static_cast<std::size_t>(share * double(samples - 1))]; };
    const double uninterrupted = *std::max_element(fastest.begin(), fastest.end());
    std::printf("| %s | %.2f | %.2f | %.1f | %.1f |\n", name, part(0.5), part(0.999), first.back(), uninterrupted);
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
    std::printf("| one sample, µs (%zu at 1 kHz) | median | 99.9 %% | worst | worst, fastest of %d runs |\n", samples, kRuns);
    std::printf("|---|---|---|---|---|\n");
    measure("the clock alone", samples, [] { return [](std::size_t) {}; });
    measure("`trocar::Compensator::step`", samples, [&] {
        return [&, observer = trocar::Compensator(model, settings.compensator)](std::size_t tick) mutable {
            sum_n += observer.step(inputs[tick].position_m, inputs[tick].reading_n, 1e-3).trocar_force_n;
        };
    });
    std::size_t done = 0;
    measure("`trocar_ros::TissueForce`, position and reading", samples, [&] {
        return [&, tissue = trocar_ros::TissueForce(model, settings)](std::size_t tick) mutable {
            const auto stamp_ns = static_cast<std::int64_t>(tick) * 1'000'000;
            tissue.add_position(stamp_ns, inputs[tick].position_m);
            tissue.add_reading(stamp_ns, inputs[tick].reading_n);
            while (const auto sample = tissue.next()) {
                sum_n += sample->estimate.trocar_force_n;
                ++done;
            }
        };
    });
    if (done != kRuns * samples || !(sum_n == sum_n)) {
        std::fprintf(stderr, "%zu samples came of %zu\n", done, kRuns * samples);
        return 1;
    }
    return 0;
} catch (const trocar::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
