/*
 * The force on the tissue from two streams of time-stamped samples: positions of the instrument and readings of a force
 * sensor outside the body. Knows nothing of ROS; the ROS node, the ros2_control broadcaster and the dVRK component run it.
 *
 *     trocar_ros::TissueForce tissue(trocar::Model::load("model.json"));        // throws trocar::Error
 *     tissue.add_position(stamp_ns, position_m);                                // as they arrive, in any order of topics
 *     tissue.add_reading(stamp_ns, reading_n);
 *     while (auto sample = tissue.next()) use(sample->tissue_force_n(), sample->variance_n2);
 *
 * Units are SI; positive is insertion; forces are those that the instrument exerts. Readings have the sign that the sensor gives them:
 * the observer reverses them where the recordings of the model were read with the sign reversed.
 *
 * How the streams are joined: as docs/reference/robot-logs.md describes for recordings. There is one sample for each position, at its
 * stamp. The reading is interpolated linearly between the readings before and after it; a reading at exactly that stamp is
 * used alone. So a sample waits for the first reading at or after it: at most one interval of the readings. Nothing is
 * extrapolated, and nothing is interpolated across more than longest_interval_s: there the sample has no reading, and no
 * tissue force. Positions before the first reading are left out: no observer
 * starts without one.
 *
 * Time is that of the stamps. A stamp that repeats, or lies up to 1 s before the last one of its stream, is ignored and
 * counted. One that is further away, before or after, is accepted when the next one follows it within 1 s, so that a
 * single wrong stamp changes nothing: before, the clock was set back and both streams start anew; after, the stream had
 * stopped. In both cases the state of the seal is unknown until it has slid (TROCAR_FAULT_GAP).
 *
 * Nothing here throws or allocates but try_make(), try_load() and the constructor. One thread at a time.
 */
#ifndef TROCAR_ROS__TISSUE_FORCE_HPP_
#define TROCAR_ROS__TISSUE_FORCE_HPP_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include <trocar.hpp>

namespace trocar_ros {

/** Stamps further apart than this are not two successive samples, ns. */
constexpr std::int64_t kJump_ns = 1'000'000'000;

/** Largest longest_interval_s, s. */
constexpr double kLongestInterval_s = 1.0;

/** How a TissueForce is set up. */
struct Settings {
    trocar::CompensatorOptions compensator;
    /**
     * Longest interval between two readings across which one is interpolated, and the longest time that a position waits
     * for a reading, s; above 0, at most kLongestInterval_s.
     */
    double longest_interval_s = 0.05;
};

/** One compensated sample. */
struct Sample {
    std::int64_t stamp_ns = 0;
    /** Of the instrument, m. */
    double position_m = 0.0;
    /** Of the sensor at stamp_ns, interpolated, N; NaN where there is none. */
    double reading_n = 0.0;
    /** Forces, standard deviation, fault. */
    trocar::Estimate estimate;
    /** Variance of the tissue force, N²; infinite where the tissue force is NaN. */
    double variance_n2 = 0.0;

    /** Force on the tissue, N; NaN where the reading does not determine it. */
    double tissue_force_n() const noexcept { return estimate.tissue_force_n; }
};

/** What happened to the samples of one stream, since the start. */
struct StreamCounts {
    std::uint64_t accepted = 0;
    /** NaN or infinite values among those accepted. */
    std::uint64_t not_finite = 0;
    /** Ignored: stamp equal to the last one. */
    std::uint64_t repeated = 0;
    /** Ignored: stamp up to 1 s before the last one. */
    std::uint64_t late = 0;
    /** Ignored: stamp more than 1 s from the last one; the next one may confirm it. */
    std::uint64_t stray = 0;
    /** Stamps that went on after more than 1 s. */
    std::uint64_t resumed = 0;
    /** Stamps that went back by more than 1 s and on from there. */
    std::uint64_t set_back = 0;
};

/** What happened since the start. */
struct Counts {
    StreamCounts positions;
    StreamCounts readings;
    std::uint64_t samples = 0;
    /** Positions without a sample: before the first reading, or set aside when the clock was set back. */
    std::uint64_t left_out = 0;
    /** Samples by fault; the place is the trocar::Fault. */
    std::array<std::uint64_t, TROCAR_FAULT_OPPOSITE_SIGN + 1> faults{};
};

/** Time-stamped values, oldest first; a full one forgets its oldest. */
class Queue {
  public:
    struct Entry {
        std::int64_t stamp_ns = 0;
        double value = 0.0;
    };

    bool empty() const noexcept { return size_ == 0; }
    std::size_t size() const noexcept { return size_; }
    const Entry &operator[](std::size_t place) const noexcept { return entries_[(first_ + place) % entries_.size()]; }
    const Entry &back() const noexcept { return (*this)[size_ - 1]; }
    void clear() noexcept { size_ = 0; }

    void pop() noexcept {
        first_ = (first_ + 1) % entries_.size();
        --size_;
    }

    /** Whether nothing was forgotten. */
    bool push(Entry entry) noexcept {
        const bool is_full = size_ == entries_.size();
        if (is_full) {
            pop();
        }
        entries_[(first_ + size_) % entries_.size()] = entry;
        ++size_;
        return !is_full;
    }

  private:
    std::array<Entry, 4096> entries_{}; // kLongestInterval_s at 4 kHz
    std::size_t first_ = 0;
    std::size_t size_ = 0;
};

/** Decides which stamps of a stream are accepted. */
class Clock {
  public:
    enum class Verdict { accepted, ignored, set_back };

    Verdict take(std::int64_t stamp_ns, StreamCounts &counts) noexcept;
    std::optional<std::int64_t> last_ns() const noexcept { return last_ns_; }

  private:
    std::optional<std::int64_t> last_ns_;
    /** A stamp far from the last one, until the next one confirms it. */
    std::optional<std::int64_t> stray_ns_;
};

/** The force on the tissue from positions and readings, sample by sample. */
class TissueForce {
  public:
    /** Nothing where a setting or option is refused, and why. */
    static std::optional<TissueForce> try_make(const trocar::Model &model, const Settings &settings = {},
                                               trocar::Refusal *why = nullptr);

#if TROCAR_HAS_EXCEPTIONS
    /** As try_make(), but throws trocar::Error. */
    explicit TissueForce(const trocar::Model &model, const Settings &settings = {});
#endif

    /**
     * For the model file at path, which is read once; nothing where the file, a setting or an option is refused, and why.
     */
    static std::optional<TissueForce> try_load(const std::string &path, const Settings &settings = {},
                                               trocar::Refusal *why = nullptr);

    /** Takes a position, m. Any number and any stamp. */
    void add_position(std::int64_t stamp_ns, double position_m) noexcept;

    /** Takes a reading of the sensor, N. As add_position(). */
    void add_reading(std::int64_t stamp_ns, double reading_n) noexcept;

    /** The next sample that is complete; call it until there is none, after each sample added. */
    std::optional<Sample> next() noexcept;

    const Counts &counts() const noexcept { return counts_; }
    trocar::Drift drift() const noexcept { return observer_.drift(); }

    /** Newest position's stamp less the newest reading's, s; far from 0 where two clocks stamp. Nothing before both came. */
    std::optional<double> stamps_apart_s() const noexcept;

  private:
    /** What is known of a reading at some stamp. */
    struct Reading {
        enum class State { known, awaited, before_first, missing } state;
        double value_n;
    };

    TissueForce(trocar::Compensator observer, std::int64_t longest_interval_ns) noexcept
        : observer_(std::move(observer)), longest_interval_ns_(longest_interval_ns) {}

    void start_anew() noexcept;
    double seconds(std::int64_t stamp_ns) const noexcept;
    Reading reading_at(std::int64_t stamp_ns) noexcept;
    Sample step(Queue::Entry position, double reading_n) noexcept;

    trocar::Compensator observer_;
    std::int64_t longest_interval_ns_;
    Clock position_clock_;
    Clock reading_clock_;
    Queue positions_;
    Queue readings_;
    /** The first stamp, zero of the times computed with, so that no digits are lost. */
    std::optional<std::int64_t> origin_ns_;
    /** Time of the last sample; nothing before the first, and after the clock was set back. */
    std::optional<double> before_s_;
    bool has_started_ = false;
    Counts counts_;
};

} // namespace trocar_ros

#endif // TROCAR_ROS__TISSUE_FORCE_HPP_
