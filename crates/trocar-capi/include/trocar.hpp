/*
 * trocar for C++17: the functions of trocar.h with owners. Header only; link with the C library.
 *
 *     trocar::Model model = trocar::Model::load("model.json");     // throws trocar::Error
 *     trocar::State seal(model, 0.1);                               // at rest, the instrument at 100 mm
 *     trocar::Step step = seal.step_to(0.1005, 1e-3);               // never throws, never allocates
 *     if (step) apply(-step.force_n);                               // the instrument feels the negative
 *
 * SI units. Positive is insertion. Forces are those of the instrument on the seal.
 *
 * Threads: a Model never changes and may be copied and used by any number of threads. A State belongs to one thread at a
 * time, and so does a Compensator. A State keeps its Model alive.
 *
 * Without exceptions (-fno-exceptions) what throws is left out; try_load() and its like do the same.
 *
 * Licence: MIT OR Apache-2.0.
 */
#ifndef TROCAR_HPP
#define TROCAR_HPP

#if !(__cplusplus >= 201703L || (defined(_MSVC_LANG) && _MSVC_LANG >= 201703L))
#error "trocar.hpp needs C++17"
#endif

#include <array>
#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "trocar.h"

#if defined(__cpp_exceptions) || defined(_CPPUNWIND)
#define TROCAR_HAS_EXCEPTIONS 1
#else
#define TROCAR_HAS_EXCEPTIONS 0
#endif

namespace trocar {

/** What became of a call; TROCAR_STATUS_OK is 0. */
using Status = trocar_status;

/** What a status means, in English. */
inline const char *message(Status status) noexcept { return trocar_status_message(status); }

/** Whether the library is the one that this header belongs to. */
inline bool fits_library() noexcept { return trocar_abi_version() == TROCAR_ABI_VERSION; }

/** Force after a step, and whether the step was done. */
struct Step {
    /** N, of the instrument on the seal; where the step was refused, the force before it. */
    double force_n = 0.0;
    Status status = TROCAR_STATUS_OK;

    explicit operator bool() const noexcept { return status == TROCAR_STATUS_OK; }
};

/** Whether the seal deforms or slides. */
enum class Mode { deforming = TROCAR_MODE_DEFORMING, sliding = TROCAR_MODE_SLIDING };

/** A saved state. */
using Numbers = std::array<double, TROCAR_STATE_NUMBERS>;

/** Why something was refused. */
struct Refusal {
    Status status = TROCAR_STATUS_OK;
    /** The whole story, with the place in the model file. */
    std::string text;
};

#if TROCAR_HAS_EXCEPTIONS
/** A refusal, thrown. */
class Error : public std::runtime_error {
  public:
    explicit Error(const Refusal &why) : std::runtime_error(why.text), status_(why.status) {}
    explicit Error(Status status) : std::runtime_error(trocar::message(status)), status_(status) {}

    Status status() const noexcept { return status_; }

  private:
    Status status_;
};
#endif

/** A number of a model that can be adjusted by itself. */
struct Tunable {
    std::string name;
    std::string unit;
    std::string description;
    double value = 0.0;
    double least = 0.0;
    bool above_least = false;
    /** Which of several elements, from 1; 0 for what the model has once. */
    int element = 0;
};

/** A model; copies share it. */
class Model {
  public:
    /** Reads the model file at path; nothing where it is refused, and why. */
    static std::optional<Model> try_load(const std::string &path, Refusal *why = nullptr) {
        return made(why, [&](trocar_model **model, char *text, std::size_t size) {
            return trocar_model_load(path.c_str(), model, text, size);
        });
    }

    /** The same from the text of a model file. */
    static std::optional<Model> try_parse(std::string_view json, Refusal *why = nullptr) {
        return made(why, [&](trocar_model **model, char *text, std::size_t size) {
            return trocar_model_parse(json.empty() ? "" : json.data(), json.size(), model, text, size);
        });
    }

    /** A copy with new values, in the order of tunables(); missing ones stay. States go on under it, State::use(). */
    std::optional<Model> try_tuned(const std::vector<double> &values, Refusal *why = nullptr) const {
        return made(why, [&](trocar_model **model, char *text, std::size_t size) {
            return trocar_model_tuned(get(), values.data(), values.size(), model, text, size);
        });
    }

    /** A made-up 10.5 mm trocar; none was measured. */
    static std::optional<Model> try_plausible(Refusal *why = nullptr) {
        return made(why, [](trocar_model **model, char *, std::size_t) { return trocar_model_plausible(model); });
    }

#if TROCAR_HAS_EXCEPTIONS
    /** As try_load(), but throws Error. */
    static Model load(const std::string &path) {
        Refusal why;
        return or_thrown(try_load(path, &why), why);
    }

    /** As try_parse(), but throws Error. */
    static Model parse(std::string_view json) {
        Refusal why;
        return or_thrown(try_parse(json, &why), why);
    }

    /** As try_plausible(), but throws Error. */
    static Model plausible() {
        Refusal why;
        return or_thrown(try_plausible(&why), why);
    }

    /** As try_tuned(), but throws Error. */
    Model tuned(const std::vector<double> &values) const {
        Refusal why;
        return or_thrown(try_tuned(values, &why), why);
    }
#endif

    /** "ems", "static", "dahl", "lugre", "leuven", "maxwell-slip", "gms" or "bouc-wen"; "" once moved from. */
    std::string_view kind() const noexcept {
        const char *kind = trocar_model_kind(get());
        return kind != nullptr ? kind : "";
    }

    /** The numbers that can be adjusted. */
    std::vector<Tunable> tunables() const {
        std::vector<Tunable> all;
        std::size_t count = 0;
        trocar_model_tunable_count(get(), &count);
        for (std::size_t index = 0; index < count; ++index) {
            trocar_tunable one{};
            if (trocar_model_tunable(get(), index, &one) == TROCAR_STATUS_OK) {
                all.push_back({one.name, one.unit, one.description, one.value, one.least, one.above_least != 0, one.element});
            }
        }
        return all;
    }

    /** For the functions of trocar.h; lives as long as this model or a copy of it. */
    const trocar_model *get() const noexcept { return model_.get(); }

  private:
    explicit Model(trocar_model *model) : model_(model, [](trocar_model *own) { trocar_model_free(own); }) {}

    template <typename Make> static std::optional<Model> made(Refusal *why, Make make) {
        Refusal own;
        trocar_model *model = nullptr;
        if (!fits_library()) {
            own = {TROCAR_STATUS_INTERNAL, "the trocar library is of another version than trocar.h"};
        } else {
            char text[TROCAR_MESSAGE_SIZE] = "";
            own.status = make(&model, text, sizeof text);
            own.text = text[0] != '\0' || own.status == TROCAR_STATUS_OK ? text : trocar::message(own.status);
        }
        if (why != nullptr) {
            *why = own;
        }
        return model != nullptr ? std::optional<Model>(Model(model)) : std::nullopt;
    }

#if TROCAR_HAS_EXCEPTIONS
    static Model or_thrown(std::optional<Model> model, const Refusal &why) {
        if (!model) {
            throw Error(why);
        }
        return *std::move(model);
    }
#endif

    std::shared_ptr<trocar_model> model_;
};

/** A seal on its way: a model and its state. Nothing in it throws or allocates but the constructor (which may throw). */
class State {
  public:
    /** An undeformed seal at rest; nothing where the position is not finite. */
    static std::optional<State> try_at(Model model, double position_m) noexcept {
        State state(std::move(model));
        const Status status = trocar_state_init(state.model_.get(), &state.state_, position_m);
        return status == TROCAR_STATUS_OK ? std::optional<State>(std::move(state)) : std::nullopt;
    }

#if TROCAR_HAS_EXCEPTIONS
    /** An undeformed seal at rest with the instrument at position_m. Throws Error where that is not finite. */
    explicit State(Model model, double position_m) : State(std::move(model)) {
        const Status status = trocar_state_init(model_.get(), &state_, position_m);
        if (status != TROCAR_STATUS_OK) {
            throw Error(status);
        }
    }
#endif

    /** Starts again, undeformed. */
    Status rest(double position_m) noexcept { return trocar_state_init(model_.get(), &state_, position_m); }

    /** Starts again, holding force_n, N. */
    Status rest_at_force(double position_m, double force_n) noexcept {
        return trocar_state_init_at_force(model_.get(), &state_, position_m, force_n);
    }

    /** Starts again with the deflection deflection_m; refused by classical models. */
    Status rest_at_deflection(double position_m, double deflection_m) noexcept {
        return trocar_state_init_at_deflection(model_.get(), &state_, position_m, deflection_m);
    }

    /** Advances by displacement_m within duration_s, which must be above 0. */
    Step step(double displacement_m, double duration_s) noexcept {
        Step step;
        step.status = trocar_step(model_.get(), &state_, displacement_m, duration_s, &step.force_n);
        return step;
    }

    /** Advances to position_m: the one to use with an encoder. */
    Step step_to(double position_m, double duration_s) noexcept {
        Step step;
        step.status = trocar_step_to(model_.get(), &state_, position_m, duration_s, &step.force_n);
        return step;
    }

    /** Advances at velocity_m_s for duration_s. */
    Step step_velocity(double velocity_m_s, double duration_s) noexcept {
        Step step;
        step.status = trocar_step_velocity(model_.get(), &state_, velocity_m_s, duration_s, &step.force_n);
        return step;
    }

    /** Many steps, trocar_simulate(). */
    Status simulate(double start_time_s, std::size_t count, const double *time_s, const double *position_m,
                    double *force_n, std::size_t *done = nullptr) noexcept {
        return trocar_simulate(model_.get(), &state_, start_time_s, count, time_s, position_m, force_n, done);
    }

    /** Goes on under a model tuned from the present one; refused for any other. */
    Status use(Model tuned) noexcept {
        // No row: only whether the state is one of that model.
        const Status status = trocar_simulate(tuned.get(), &state_, 0.0, 0, nullptr, nullptr, nullptr, nullptr);
        if (status == TROCAR_STATUS_OK) {
            model_ = std::move(tuned);
        }
        return status;
    }

    /** Force after the last step, N. */
    double force_n() const noexcept {
        double force = 0.0;
        trocar_state_force(&state_, &force);
        return force;
    }

    /** Where the instrument is, m. */
    double position_m() const noexcept {
        double position = 0.0;
        trocar_state_position(&state_, &position);
        return position;
    }

    /** Deflection of the seal, m; nothing for a classical model. */
    std::optional<double> deflection_m() const noexcept {
        double deflection = 0.0;
        const Status status = trocar_state_deflection(model_.get(), &state_, &deflection);
        return status == TROCAR_STATUS_OK ? std::optional<double>(deflection) : std::nullopt;
    }

    /** Whether the seal deforms or slides; nothing for a classical model. */
    std::optional<Mode> mode() const noexcept {
        int32_t mode = 0;
        const Status status = trocar_state_mode(model_.get(), &state_, &mode);
        return status == TROCAR_STATUS_OK ? std::optional<Mode>(static_cast<Mode>(mode)) : std::nullopt;
    }

    /** The state as numbers. */
    Numbers save() const noexcept {
        Numbers numbers{};
        trocar_state_save(&state_, numbers.data(), numbers.size());
        return numbers;
    }

    /** Back to a saved state, of this model or one of its kind. */
    Status restore(const Numbers &numbers) noexcept {
        return trocar_state_restore(model_.get(), &state_, numbers.data(), numbers.size(), nullptr, 0);
    }

    const Model &model() const noexcept { return model_; }

  private:
    explicit State(Model model) noexcept : model_(std::move(model)) {}

    Model model_;
    trocar_state state_{};
};

/** What cannot be right about a sample; TROCAR_FAULT_NONE is 0. */
using Fault = trocar_fault;

/** What a fault means, in English. */
inline const char *fault_message(Fault fault) noexcept { return trocar_fault_message(fault); }

/** Where friction and viscosity stand, over those of the model. */
using Drift = trocar_drift;

/** How a compensator is set up; an empty optional means: as in the model file. */
struct CompensatorOptions {
    /** Reading without any force, N, with the sign of the readings. */
    std::optional<double> offset_n;
    /** Whether the sign of each reading is reversed; nothing: as the recordings of the model file were, else not. */
    std::optional<bool> flip_force;
    /** Mass between sensor and seal, kg. */
    std::optional<double> moving_mass_kg;
    /** Gravity as it acts on the reading of the moving mass; not 0 only with an offset_n without the weight. */
    double gravity_m_s2 = 0.0;
    /** Largest force that the sensor can read, N; nothing where none is known. */
    std::optional<double> sensor_limit_n;
    /** Standard deviation of the model's force, N. */
    std::optional<double> force_error_n;
    /** Whether friction and viscosity are followed in use. */
    bool adaptation = true;
};

/** Estimate of a compensator after each sample. Forces are those of the instrument on what it touches. */
struct Estimate {
    /** On seal and trocar, N. */
    double trocar_force_n = 0.0;
    /** On the tissue, N; NaN where the reading does not determine it, and where the step was refused. */
    double tissue_force_n = std::numeric_limits<double>::quiet_NaN();
    /** Standard deviation of both, N. */
    double tissue_force_std_n = std::numeric_limits<double>::quiet_NaN();
    /** Whether friction and viscosity are being followed. */
    bool adapting = false;
    /** What cannot be right about this sample. */
    Fault fault = TROCAR_FAULT_NONE;
    Status status = TROCAR_STATUS_OK;

    /** Whether the step was done; also done, with a fault, where a reading is NaN. */
    explicit operator bool() const noexcept { return status == TROCAR_STATUS_OK; }
};

/**
 * The force on the tissue, from a sensor outside the body. Nothing in it throws or allocates but try_make() and the
 * constructor. It keeps what it needs of the model. One thread at a time.
 */
class Compensator {
  public:
    /** A compensator for the model; nothing where it is refused, and why. */
    static std::optional<Compensator> try_make(const Model &model, const CompensatorOptions &options = {},
                                               Refusal *why = nullptr) {
        Refusal own;
        trocar_compensator *made = nullptr;
        trocar_compensator_options numbers{};
        own.status = trocar_compensator_options_init(&numbers, sizeof numbers);
        if (own.status == TROCAR_STATUS_OK && !fill(options, numbers)) {
            own.status = TROCAR_STATUS_OUT_OF_RANGE;
            own.text = "an option is not a number";
        } else if (own.status == TROCAR_STATUS_OK) {
            char text[TROCAR_MESSAGE_SIZE] = "";
            own.status = trocar_compensator_new(model.get(), &numbers, &made, text, sizeof text);
            own.text = text;
        }
        if (own.status != TROCAR_STATUS_OK && own.text.empty()) {
            own.text = trocar::message(own.status);
        }
        if (why != nullptr) {
            *why = own;
        }
        return made != nullptr ? std::optional<Compensator>(Compensator(made)) : std::nullopt;
    }

#if TROCAR_HAS_EXCEPTIONS
    /** As try_make(), but throws Error. */
    explicit Compensator(const Model &model, const CompensatorOptions &options = {}) {
        Refusal why;
        std::optional<Compensator> made = try_make(model, options, &why);
        if (!made) {
            throw Error(why);
        }
        *this = *std::move(made);
    }
#endif

    /**
     * Takes the next sample: position (positive is insertion), reading with the sign that the sensor gives it, time since
     * the last sample. Any numbers, NaN too.
     */
    Estimate step(double position_m, double force_n, double duration_s) noexcept {
        trocar_estimate said{};
        Estimate step;
        step.status = trocar_compensator_step(compensator_.get(), position_m, force_n, duration_s, &said);
        if (step) {
            step.trocar_force_n = said.trocar_force_n;
            step.tissue_force_n = said.tissue_force_n;
            step.tissue_force_std_n = said.tissue_force_std_n;
            step.adapting = said.adapting != 0;
            step.fault = said.fault;
        }
        return step;
    }

    /** Where friction and viscosity stand. */
    Drift drift() const noexcept {
        Drift drift{1.0, 1.0, 0.0, 0.0};
        trocar_compensator_drift(compensator_.get(), &drift);
        return drift;
    }

    /** Forgets all samples and starts with the next one. */
    Status reset() noexcept { return trocar_compensator_reset(compensator_.get()); }

    /** For the functions of trocar.h; lives as long as this compensator. */
    trocar_compensator *get() const noexcept { return compensator_.get(); }

  private:
    struct Free {
        void operator()(trocar_compensator *own) const noexcept { trocar_compensator_free(own); }
    };

    explicit Compensator(trocar_compensator *own) noexcept : compensator_(own) {}

    /** False where a given value is NaN, which would count as not given. */
    static bool fill(const CompensatorOptions &from, trocar_compensator_options &to) noexcept {
        bool numbers = true;
        const auto set = [&numbers](const std::optional<double> &given, double &place) {
            numbers = numbers && !(given && *given != *given);
            place = given.value_or(place);
        };
        set(from.offset_n, to.offset_n);
        set(from.moving_mass_kg, to.moving_mass_kg);
        set(from.sensor_limit_n, to.sensor_limit_n);
        set(from.force_error_n, to.force_error_n);
        to.gravity_m_s2 = from.gravity_m_s2;
        to.adaptation = from.adaptation ? 1 : 0;
        to.flip_force = from.flip_force ? static_cast<int>(*from.flip_force) : -1;
        return numbers;
    }

    std::unique_ptr<trocar_compensator, Free> compensator_;
};

} // namespace trocar

#endif // TROCAR_HPP
