// The library without ROS: how two streams are joined, and what bad stamps and values do. Usage: tissue_force_test MODEL.json
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <new>
#include <string>
#include <vector>

#include <trocar_ros/axis.hpp>
#include <trocar_ros/health.hpp>
#include <trocar_ros/setup.hpp>
#include <trocar_ros/tissue_force.hpp>

#include "check.hpp"
#include "motion.hpp"

using trocar_ros::Sample;
using trocar_ros::Settings;
using trocar_ros::TissueForce;

/** Allocations since the start. */
static std::size_t allocations = 0;

void *operator new(std::size_t size) {
    ++allocations;
    if (void *memory = std::malloc(size)) {
        return memory;
    }
    throw std::bad_alloc();
}
void operator delete(void *memory) noexcept { std::free(memory); }
void operator delete(void *memory, std::size_t) noexcept { std::free(memory); }

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

std::string model_path;

TissueForce made() {
    Settings settings;
    settings.compensator.force_error_n = 0.1;
    trocar::Refusal why;
    std::optional<TissueForce> tissue = TissueForce::try_load(model_path, settings, &why);
    if (!tissue) {
        std::fprintf(stderr, "%s\n", why.text.c_str());
        std::exit(1);
    }
    return *std::move(tissue);
}

double seconds(std::int64_t stamp_ns) { return static_cast<double>(stamp_ns - kStart_ns) / 1e9; }

void add_position(TissueForce &tissue, std::int64_t stamp_ns) {
    tissue.add_position(stamp_ns, motion::position_m(seconds(stamp_ns)));
}

void add_reading(TissueForce &tissue, std::int64_t stamp_ns) {
    const std::int64_t tick = (stamp_ns - kStart_ns) / kMs;
    tissue.add_reading(stamp_ns, motion::reading_n(seconds(stamp_ns), static_cast<unsigned long>(tick)));
}

std::vector<Sample> samples(TissueForce &tissue) {
    std::vector<Sample> all;
    while (std::optional<Sample> sample = tissue.next()) {
        all.push_back(*sample);
    }
    return all;
}

/** Both topics every millisecond, from tick to before end; what comes out. */
std::vector<Sample> run(TissueForce &tissue, int tick, int end, std::int64_t start_ns = kStart_ns) {
    std::vector<Sample> all;
    for (; tick < end; ++tick) {
        add_position(tissue, start_ns + tick * kMs);
        add_reading(tissue, start_ns + tick * kMs);
        for (const Sample &sample : samples(tissue)) {
            all.push_back(sample);
        }
    }
    return all;
}

bool same(double one, double other) { return one == other || (std::isnan(one) && std::isnan(other)); }

bool same(const Sample &one, const Sample &other) {
    return one.stamp_ns == other.stamp_ns && same(one.estimate.trocar_force_n, other.estimate.trocar_force_n) &&
           same(one.tissue_force_n(), other.tissue_force_n()) && same(one.variance_n2, other.variance_n2) &&
           one.estimate.fault == other.estimate.fault;
}

bool same(const std::vector<Sample> &one, const std::vector<Sample> &other) {
    bool all = one.size() == other.size();
    for (std::size_t k = 0; all && k < one.size(); ++k) {
        all = same(one[k], other[k]);
    }
    return all;
}

bool is_determined(const Sample &sample) {
    return std::isfinite(sample.tissue_force_n()) && std::isfinite(sample.variance_n2) && sample.variance_n2 > 0.0;
}

bool is_undetermined(const Sample &sample) {
    return std::isnan(sample.tissue_force_n()) && sample.variance_n2 == std::numeric_limits<double>::infinity() &&
           std::isfinite(sample.estimate.trocar_force_n);
}

/** Stamps of both topics alike: the numbers of a Compensator that takes the same samples, bit for bit. */
void equals_the_observer() {
    TissueForce tissue = made();
    trocar::CompensatorOptions options;
    options.force_error_n = 0.1;
    trocar::Compensator observer(trocar::Model::load(model_path), options);
    const std::vector<Sample> all = run(tissue, 0, 5000);
    CHECK(all.size() == 5000);
    double before_s = 0.0;
    for (std::size_t k = 0; k < all.size(); ++k) {
        const double time_s = seconds(kStart_ns + static_cast<std::int64_t>(k) * kMs);
        const trocar::Estimate own =
            observer.step(motion::position_m(time_s), motion::reading_n(time_s, k), time_s - before_s);
        before_s = time_s;
        CHECK(same(all[k].estimate.tissue_force_n, own.tissue_force_n) && all[k].estimate.fault == own.fault);
        CHECK(all[k].variance_n2 == own.tissue_force_std_n * own.tissue_force_std_n);
    }
}

/** The order in which the topics arrive, and duplicates of messages, change nothing. */
void order_of_topics() {
    TissueForce together = made();
    const std::vector<Sample> expected = run(together, 0, 600);
    TissueForce late_readings = made();
    TissueForce late_positions = made();
    std::vector<Sample> one;
    std::vector<Sample> other;
    for (int tick = 0; tick < 600 + 20; ++tick) {
        if (tick < 600) {
            add_position(late_readings, kStart_ns + tick * kMs);
            add_position(late_readings, kStart_ns + tick * kMs);
            add_reading(late_positions, kStart_ns + tick * kMs);
        }
        if (tick >= 20) {
            add_reading(late_readings, kStart_ns + (tick - 20) * kMs);
            add_position(late_positions, kStart_ns + (tick - 20) * kMs);
            add_position(late_positions, kStart_ns + (tick - 20) * kMs);
        }
        for (const Sample &sample : samples(late_readings)) {
            one.push_back(sample);
        }
        for (const Sample &sample : samples(late_positions)) {
            other.push_back(sample);
        }
    }
    CHECK(same(expected, one));
    CHECK(same(expected, other));
    CHECK(late_readings.counts().positions.repeated == 600 && late_positions.counts().positions.repeated == 600);
}

/** A linear reading interpolated is that line, whatever the two rates; one sample a position. */
void different_rates(int position_ms, int reading_ms) {
    TissueForce tissue = made();
    const auto line = [](std::int64_t stamp_ns) { return 0.5 + 0.25 * seconds(stamp_ns); };
    std::vector<Sample> all;
    const int end = 1050; // a multiple of all intervals: the last position has a reading
    for (int tick = 0; tick <= end; ++tick) {
        const std::int64_t stamp_ns = kStart_ns + tick * kMs;
        if (tick % position_ms == 0) {
            add_position(tissue, stamp_ns);
        }
        if (tick % reading_ms == 0) {
            tissue.add_reading(stamp_ns, line(stamp_ns));
        }
        for (const Sample &sample : samples(tissue)) {
            all.push_back(sample);
        }
    }
    CHECK(all.size() == static_cast<std::size_t>(end / position_ms + 1));
    for (const Sample &sample : all) {
        CHECK(std::abs(sample.reading_n - line(sample.stamp_ns)) < 1e-12);
        CHECK(sample.estimate.fault == TROCAR_FAULT_NONE);
    }
}

/** The rate of both topics changes from 1 kHz to 100 Hz and back. */
void rate_changes() {
    TissueForce tissue = made();
    std::size_t count = 0;
    for (int tick = 0; tick < 3000; ++tick) {
        if (tick < 1000 || tick >= 2000 || tick % 10 == 0) {
            add_position(tissue, kStart_ns + tick * kMs);
            add_reading(tissue, kStart_ns + tick * kMs);
        }
        for (const Sample &sample : samples(tissue)) {
            CHECK(is_determined(sample) && sample.estimate.fault == TROCAR_FAULT_NONE);
            ++count;
        }
    }
    CHECK(count == 2100);
}

/** The readings stop: the model goes on with the motion, there is no tissue force, and it comes back with the readings. */
void readings_stop() {
    TissueForce tissue = made();
    run(tissue, 0, 500);
    for (int tick = 500; tick < 1000; ++tick) {
        add_position(tissue, kStart_ns + tick * kMs);
        for (const Sample &sample : samples(tissue)) {
            CHECK(is_undetermined(sample) && sample.estimate.fault == TROCAR_FAULT_NO_READING);
        }
    }
    CHECK(tissue.counts().samples == 500 + 450 - 1); // those of the last 50 ms may still get a reading
    const std::vector<Sample> after = run(tissue, 1000, 1200);
    CHECK(after.size() == 51 + 199 + 1 && is_determined(after.back()));
    CHECK(tissue.counts().faults[TROCAR_FAULT_GAP] == 0 && tissue.counts().left_out == 0);
}

/** Readings with a gap that arrive before the positions: nothing is interpolated across it. */
void gap_in_readings() {
    TissueForce tissue = made();
    for (int tick = 0; tick < 400; ++tick) {
        if (tick <= 100 || tick >= 300) {
            add_reading(tissue, kStart_ns + tick * kMs);
        }
    }
    for (int tick = 0; tick < 400; ++tick) {
        add_position(tissue, kStart_ns + tick * kMs);
        const std::optional<Sample> sample = tissue.next();
        CHECK(sample && (tick > 100 && tick < 300 ? is_undetermined(*sample) : is_determined(*sample)));
    }
}

/** The positions stop: no sample; then a gap, after which the band is wide until the seal has slid. */
void positions_stop(int pause_ms) {
    TissueForce tissue = made();
    const double before = run(tissue, 0, 2500).back().variance_n2;
    for (int tick = 2500; tick < 2500 + pause_ms; ++tick) {
        add_reading(tissue, kStart_ns + tick * kMs);
        CHECK(!tissue.next());
    }
    const std::vector<Sample> after = run(tissue, 2500 + pause_ms, 2600 + pause_ms);
    // Longer than a second, the first position only confirms the second.
    CHECK(after.size() == (pause_ms > 1000 ? 99U : 100U));
    CHECK(after.front().estimate.fault == TROCAR_FAULT_GAP && after[1].estimate.fault == TROCAR_FAULT_NONE);
    CHECK(after.front().variance_n2 > before);
    CHECK(tissue.counts().positions.resumed == (pause_ms > 1000 ? 1 : 0));
}

/** NaN on either topic. */
void not_a_number() {
    TissueForce tissue = made();
    run(tissue, 0, 500);
    for (int tick = 500; tick < 600; ++tick) {
        const bool is_position = tick < 550;
        tissue.add_position(kStart_ns + tick * kMs, is_position ? kNan : motion::position_m(tick / 1e3));
        tissue.add_reading(kStart_ns + tick * kMs, is_position ? 1.0 : std::numeric_limits<double>::infinity());
        const std::optional<Sample> sample = tissue.next();
        CHECK(sample && is_undetermined(*sample));
        CHECK(sample && sample->estimate.fault == (is_position ? TROCAR_FAULT_NO_POSITION : TROCAR_FAULT_NO_READING));
    }
    CHECK(tissue.counts().positions.not_finite == 50 && tissue.counts().readings.not_finite == 50);
    CHECK(is_determined(run(tissue, 600, 601).front()));
}

/** Late, repeated and single wrong stamps of either topic leave the rest as it is. */
void wrong_stamps() {
    TissueForce clean = made();
    const std::vector<Sample> expected = run(clean, 0, 1000);
    TissueForce tissue = made();
    std::vector<Sample> all;
    for (int tick = 0; tick < 1000; ++tick) {
        for (const Sample &sample : run(tissue, tick, tick + 1)) {
            all.push_back(sample);
        }
        for (const std::int64_t step_ns : {-5 * kMs, -500 * kMs, -3600'000 * kMs, 3600'000 * kMs, -kStart_ns}) {
            if (tick % 100 == 7) {
                tissue.add_position(kStart_ns + tick * kMs + step_ns, 5.0);
                tissue.add_reading(kStart_ns + tick * kMs + step_ns, 99.0);
                CHECK(!tissue.next());
            }
        }
        if (tick % 100 == 8) {
            tissue.add_position(std::numeric_limits<std::int64_t>::min(), 5.0);
            tissue.add_reading(std::numeric_limits<std::int64_t>::max(), 99.0);
        }
    }
    CHECK(same(expected, all));
    for (const trocar_ros::StreamCounts &counts : {tissue.counts().positions, tissue.counts().readings}) {
        CHECK(counts.accepted == 1000 && counts.late == 20 && counts.stray == 40 && counts.set_back == 0);
    }
}

/** Stamps at the ends of their range: their differences do not overflow (test/CMakeLists.txt traps it). */
void farthest_stamps() {
    constexpr std::int64_t kEnd_ns = std::int64_t{1} << 62;
    for (const std::int64_t stamp_ns : {kEnd_ns, -kEnd_ns, std::numeric_limits<std::int64_t>::max()}) {
        TissueForce tissue = made();
        tissue.add_position(stamp_ns, 0.0);
        tissue.add_reading(stamp_ns, 1.0);
        CHECK(tissue.counts().positions.accepted == 0 && tissue.counts().positions.stray == 1);
        CHECK(tissue.counts().readings.stray == 1 && !tissue.next() && !tissue.stamps_apart_s());
    }
    for (const std::int64_t sign : {1, -1}) {
        TissueForce tissue = made();
        for (const std::int64_t stamp_ns : {kEnd_ns - 1, -(kEnd_ns - 1)}) {
            tissue.add_position(sign * stamp_ns, 0.0);
            tissue.add_reading(-sign * stamp_ns, 1.0);
            CHECK(!tissue.next());
        }
        CHECK(tissue.counts().positions.accepted == 1 && tissue.counts().readings.stray == 1);
        CHECK(std::abs(*tissue.stamps_apart_s() - static_cast<double>(sign) * 9.223372e9) < 1e4);
        // The stream that was set back goes on from there; the other would leave the range.
        tissue.add_position(-sign * (kEnd_ns - 1) + kMs, 0.0);
        tissue.add_reading(sign * (kEnd_ns - 1) + kMs, 1.0);
        CHECK(!tissue.next());
        CHECK(tissue.counts().positions.set_back == (sign > 0) && tissue.counts().readings.set_back == (sign < 0));
    }
}

/** The clock is set back by an hour, as when a bag is played again: both start anew, and the drift is kept. */
void clock_set_back(void (*add_ahead)(TissueForce &, std::int64_t)) {
    TissueForce tissue = made();
    run(tissue, 0, 3000);
    const trocar::Drift drift = tissue.drift();
    for (int tick = 3000; tick < 3040; ++tick) {
        add_ahead(tissue, kStart_ns + tick * kMs); // one topic is ahead of the other when the clock is set back
    }
    const std::vector<Sample> after = run(tissue, 0, 200, kStart_ns - 3600'000 * kMs);
    CHECK(tissue.counts().positions.set_back == 1 && tissue.counts().readings.set_back == 1);
    CHECK(after.size() >= 198 && after.front().estimate.fault == TROCAR_FAULT_GAP);
    CHECK(is_determined(after.back()) && after.back().estimate.fault == TROCAR_FAULT_NONE);
    CHECK(tissue.drift().level == drift.level && tissue.drift().viscosity == drift.viscosity);
}

/** Two clocks: no tissue force is made up from readings that lie elsewhere in time, and the distance is known. */
void two_clocks() {
    for (const std::int64_t apart_ns : {-1000'000 * kMs, 1000'000 * kMs}) {
        TissueForce tissue = made();
        for (int tick = 0; tick < 1000; ++tick) {
            add_position(tissue, kStart_ns + tick * kMs);
            add_reading(tissue, kStart_ns + tick * kMs + apart_ns);
            CHECK(!tissue.next());
        }
        CHECK(std::abs(*tissue.stamps_apart_s() + static_cast<double>(apart_ns) / 1e9) < 1e-6);
        CHECK(tissue.counts().samples == 0 && tissue.counts().left_out > 900);
    }
}

/** A queue that nobody empties forgets the oldest and counts them. */
void full_queue() {
    TissueForce tissue = made();
    for (int tick = 0; tick < 10'000; ++tick) {
        add_position(tissue, kStart_ns + tick * kMs / 10);
    }
    CHECK(tissue.counts().left_out == 10'000 - 4096);
}

/** Nothing is allocated for a sample, whatever is wrong with it. */
void no_allocation() {
    TissueForce tissue = made();
    const std::size_t before = allocations;
    for (int tick = 0; tick < 6000; ++tick) {
        add_position(tissue, kStart_ns + (tick % 700 == 0 ? -1 : 1) * tick * kMs);
        if (tick % 1000 < 800) {
            tissue.add_reading(kStart_ns + tick * kMs, tick % 50 == 0 ? kNan : 1.0 + tick % 3);
        }
        while (tissue.next()) {
        }
    }
    CHECK(allocations == before && tissue.counts().samples > 4000);
}

void refusals() {
    trocar::Refusal why;
    CHECK(!TissueForce::try_load("no/such/file.json", {}, &why) && why.text.find("no/such/file.json") != std::string::npos);
    Settings settings;
    settings.compensator.force_error_n = 0.1;
    for (const double interval_s : {0.0, -1.0, 1.5, kNan}) {
        settings.longest_interval_s = interval_s;
        CHECK(!TissueForce::try_load(model_path, settings, &why) && why.status == TROCAR_STATUS_OUT_OF_RANGE);
    }
    settings = {};
    CHECK(!TissueForce::try_load(model_path, settings, &why) && why.text.find("force_error") != std::string::npos);
}

trocar_ros::NodeParameters parameters() {
    trocar_ros::NodeParameters parameters;
    parameters.model_path = model_path;
    parameters.force_error_n = 0.1;
    return parameters;
}

/** A change that is validated runs when it is applied, not before, and not if another one was validated or refused since. */
void change_in_two_steps() {
    trocar_ros::Setup<trocar_ros::NodeParameters> setup;
    setup.start(parameters());
    CHECK(setup.tissue() != nullptr && setup.refusal().empty() && !setup.apply());
    run(*setup.tissue(), 0, 100);
    trocar_ros::NodeParameters wanted = parameters();
    wanted.force_axis = "-x";
    std::string why;
    CHECK(setup.validate(wanted, false, why) && why.empty());
    CHECK(setup.parameters().force_axis == "z" && setup.axis().component == 2 && setup.tissue()->counts().samples == 100);
    trocar_ros::NodeParameters other = parameters();
    other.force_axis = "y";
    CHECK(setup.validate(other, false, why) && setup.apply());
    CHECK(setup.parameters().force_axis == "y" && setup.axis().component == 1 && setup.tissue()->counts().samples == 0);
    CHECK(!setup.apply() && setup.axis().component == 1);
    // Refused: nothing is left to apply, of this change or of the one before.
    CHECK(setup.validate(wanted, false, why));
    for (const double stale_after_s : {kNan, std::numeric_limits<double>::infinity()}) {
        other.stale_after_s = stale_after_s;
        CHECK(!setup.validate(other, false, why) && why == "stale_after_s must be finite" && !setup.apply());
    }
    other = parameters();
    other.model_path = "no/such/file.json";
    CHECK(!setup.validate(other, true, why) && why.find("no/such/file.json") != std::string::npos && !setup.apply());
    CHECK(setup.validate(wanted, false, why));
    setup.forget();
    CHECK(!setup.apply() && setup.parameters().force_axis == "y" && setup.tissue() != nullptr);
}

/** Without a model it waits, and reads one with the first change that is accepted. */
void change_without_model() {
    trocar_ros::Setup<trocar_ros::NodeParameters> setup;
    setup.start(trocar_ros::NodeParameters());
    CHECK(setup.tissue() == nullptr && setup.refusal().find("model_path is empty") != std::string::npos);
    std::string why;
    CHECK(setup.validate(parameters(), false, why) && setup.tissue() == nullptr);
    CHECK(setup.apply() && setup.tissue() != nullptr && setup.refusal().empty());
}

/** The worst level wins, whatever the order of the findings, and no reason is lost. */
void health() {
    using trocar_ros::Level;
    trocar_ros::Health health;
    CHECK(health.level() == Level::ok && health.reasons().empty());
    health.raise(Level::warn, "a");
    CHECK(health.level() == Level::warn);
    health.raise(Level::error, "b");
    health.raise(Level::stale, "c");
    CHECK(health.level() == Level::error && health.reasons() == "a; b; c");
    trocar_ros::Health other;
    other.raise(Level::stale, "c");
    other.raise(Level::warn, "a");
    CHECK(other.level() == Level::stale);
    other.raise(Level::error, "b");
    CHECK(other.level() == Level::error);
}

void axes() {
    using trocar_ros::Axis;
    CHECK(Axis::parse("z")->of({1.0, 2.0, 3.0}) == 3.0 && Axis::parse("-y")->of({1.0, 2.0, 3.0}) == -2.0);
    CHECK(Axis::parse("-x")->along(4.0)[0] == -4.0 && Axis::parse("-x")->along(4.0)[2] == 0.0);
    for (const char *name : {"", "-", "w", "xy", "--x", "Z"}) {
        CHECK(!Axis::parse(name));
    }
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: tissue_force_test MODEL.json\n");
        return 2;
    }
    model_path = argv[1];
    equals_the_observer();
    order_of_topics();
    different_rates(1, 10);
    different_rates(10, 1);
    different_rates(3, 7);
    rate_changes();
    readings_stop();
    gap_in_readings();
    positions_stop(300);
    positions_stop(30'000);
    not_a_number();
    wrong_stamps();
    farthest_stamps();
    clock_set_back(add_position);
    clock_set_back(add_reading);
    two_clocks();
    full_queue();
    no_allocation();
    refusals();
    axes();
    change_in_two_steps();
    change_without_model();
    health();
    return failed;
}
