#include <trocar_ros/tissue_force.hpp>

#include <cmath>
#include <limits>
#include <utility>

namespace trocar_ros {

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/** Stands for the unknown time since the last sample after the clock was set back, s: long enough for TROCAR_FAULT_GAP. */
constexpr double kUnknownDuration_s = 1.0;

/** Stamps beyond this are refused, so that the difference of any two others fits their type, ns. */
constexpr std::int64_t kFarthest_ns = (std::int64_t{1} << 62) - 1;

} // namespace

Clock::Verdict Clock::take(std::int64_t stamp_ns, StreamCounts &counts) noexcept {
    if (stamp_ns > kFarthest_ns || stamp_ns < -kFarthest_ns) {
        ++counts.stray;
        return Verdict::ignored;
    }
    const std::int64_t step_ns = last_ns_ ? stamp_ns - *last_ns_ : 1;
    if (step_ns == 0) {
        ++counts.repeated;
        return Verdict::ignored;
    }
    if (step_ns > -kJump_ns && step_ns < 0) {
        ++counts.late;
        return Verdict::ignored;
    }
    const bool is_near = step_ns > 0 && step_ns <= kJump_ns;
    const bool follows_stray = stray_ns_ && stamp_ns > *stray_ns_ && stamp_ns - *stray_ns_ <= kJump_ns;
    if (!is_near && !follows_stray) {
        ++counts.stray;
        stray_ns_ = stamp_ns;
        return Verdict::ignored;
    }
    stray_ns_.reset();
    last_ns_ = stamp_ns;
    ++counts.accepted;
    if (is_near) {
        return Verdict::accepted;
    }
    if (step_ns > 0) {
        ++counts.resumed;
        return Verdict::accepted;
    }
    ++counts.set_back;
    return Verdict::set_back;
}

std::optional<TissueForce> TissueForce::try_make(const trocar::Model &model, const Settings &settings,
                                                 trocar::Refusal *why) {
    // Also refuses NaN.
    if (!(settings.longest_interval_s > 0.0 && settings.longest_interval_s <= kLongestInterval_s)) {
        if (why != nullptr) {
            *why = {TROCAR_STATUS_OUT_OF_RANGE, "longest_interval_s must be above 0 and at most 1 s, got " +
                                                    std::to_string(settings.longest_interval_s) + " s"};
        }
        return std::nullopt;
    }
    std::optional<trocar::Compensator> observer = trocar::Compensator::try_make(model, settings.compensator, why);
    if (!observer) {
        return std::nullopt;
    }
    return TissueForce(*std::move(observer), std::llround(settings.longest_interval_s * 1e9));
}

std::optional<TissueForce> TissueForce::try_load(const std::string &path, const Settings &settings,
                                                 trocar::Refusal *why) {
    const std::optional<trocar::Model> model = trocar::Model::try_load(path, why);
    return model ? try_make(*model, settings, why) : std::nullopt;
}

#if TROCAR_HAS_EXCEPTIONS
TissueForce::TissueForce(const trocar::Model &model, const Settings &settings)
    : TissueForce([&] {
          trocar::Refusal why;
          std::optional<TissueForce> made = try_make(model, settings, &why);
          return made ? *std::move(made) : throw trocar::Error(why);
      }()) {}
#endif

void TissueForce::add_position(std::int64_t stamp_ns, double position_m) noexcept {
    const Clock::Verdict verdict = position_clock_.take(stamp_ns, counts_.positions);
    if (verdict == Clock::Verdict::ignored) {
        return;
    }
    if (verdict == Clock::Verdict::set_back) {
        start_anew();
    }
    origin_ns_ = origin_ns_.value_or(stamp_ns);
    counts_.positions.not_finite += std::isfinite(position_m) ? 0 : 1;
    counts_.left_out += positions_.push({stamp_ns, position_m}) ? 0 : 1;
}

void TissueForce::add_reading(std::int64_t stamp_ns, double reading_n) noexcept {
    const Clock::Verdict verdict = reading_clock_.take(stamp_ns, counts_.readings);
    if (verdict == Clock::Verdict::ignored) {
        return;
    }
    if (verdict == Clock::Verdict::set_back) {
        start_anew();
    }
    origin_ns_ = origin_ns_.value_or(stamp_ns);
    counts_.readings.not_finite += std::isfinite(reading_n) ? 0 : 1;
    readings_.push({stamp_ns, reading_n});
}

std::optional<Sample> TissueForce::next() noexcept {
    while (!positions_.empty()) {
        const Queue::Entry position = positions_[0];
        const Reading reading = reading_at(position.stamp_ns);
        if (reading.state == Reading::State::awaited) {
            return std::nullopt;
        }
        positions_.pop();
        if (reading.state == Reading::State::before_first) {
            ++counts_.left_out;
            continue;
        }
        return step(position, reading.value_n);
    }
    return std::nullopt;
}

std::optional<double> TissueForce::stamps_apart_s() const noexcept {
    const std::optional<std::int64_t> position_ns = position_clock_.last_ns();
    const std::optional<std::int64_t> reading_ns = reading_clock_.last_ns();
    if (!position_ns || !reading_ns) {
        return std::nullopt;
    }
    return static_cast<double>(*position_ns - *reading_ns) / 1e9;
}

void TissueForce::start_anew() noexcept {
    counts_.left_out += positions_.size();
    positions_.clear();
    readings_.clear();
    origin_ns_.reset();
    before_s_.reset();
}

double TissueForce::seconds(std::int64_t stamp_ns) const noexcept {
    return static_cast<double>(stamp_ns - origin_ns_.value_or(stamp_ns)) / 1e9;
}

TissueForce::Reading TissueForce::reading_at(std::int64_t stamp_ns) noexcept {
    while (readings_.size() > 1 && readings_[1].stamp_ns <= stamp_ns) {
        readings_.pop();
    }
    const bool has_waited = positions_.back().stamp_ns - stamp_ns > longest_interval_ns_;
    const Reading none = {has_started_ ? Reading::State::missing : Reading::State::before_first, kNan};
    const Reading later = has_waited ? none : Reading{Reading::State::awaited, kNan};
    if (readings_.empty()) {
        return later;
    }
    if (readings_[0].stamp_ns > stamp_ns) {
        return none;
    }
    const Queue::Entry from = readings_[0];
    if (from.stamp_ns == stamp_ns) {
        return {Reading::State::known, from.value};
    }
    if (readings_.size() == 1) {
        return later;
    }
    const Queue::Entry to = readings_[1];
    if (to.stamp_ns - from.stamp_ns > longest_interval_ns_) {
        return none;
    }
    const double from_s = seconds(from.stamp_ns);
    const double share = (seconds(stamp_ns) - from_s) / (seconds(to.stamp_ns) - from_s);
    return {Reading::State::known, from.value + share * (to.value - from.value)};
}

Sample TissueForce::step(Queue::Entry position, double reading_n) noexcept {
    const double time_s = seconds(position.stamp_ns);
    // The first sample starts the observer, whatever its duration.
    const double duration_s = before_s_ ? time_s - *before_s_ : has_started_ ? kUnknownDuration_s : 0.0;
    before_s_ = time_s;
    has_started_ = true;
    Sample sample;
    sample.stamp_ns = position.stamp_ns;
    sample.position_m = position.value;
    sample.reading_n = reading_n;
    sample.estimate = observer_.step(position.value, reading_n, duration_s);
    const double std_n = sample.estimate.tissue_force_std_n;
    sample.variance_n2 =
        std::isfinite(sample.estimate.tissue_force_n) ? std_n * std_n : std::numeric_limits<double>::infinity();
    ++counts_.samples;
    ++counts_.faults[sample.estimate.fault];
    return sample;
}

} // namespace trocar_ros
