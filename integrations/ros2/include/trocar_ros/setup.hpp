/*
 * The parameters in use and the observer made from them, changed in the two steps of rclcpp: validation and application. Knows
 * nothing of ROS.
 */
#ifndef TROCAR_ROS__SETUP_HPP_
#define TROCAR_ROS__SETUP_HPP_

#include <optional>
#include <string>
#include <utility>

#include <trocar_ros/axis.hpp>
#include <trocar_ros/parameters.hpp>
#include <trocar_ros/tissue_force.hpp>

namespace trocar_ros {

/**
 * What a node runs. A change of parameters is validated first, without any effect on what runs, and applied when the host has
 * accepted it: another callback of the host may still refuse it. One thread at a time.
 */
template <typename AllParameters> class Setup {
  public:
    /** Reads the model and makes the observer; where that fails, tissue() is null and refusal() the reason. */
    void start(const AllParameters &parameters) {
        running_ = {parameters, parameters.load(refusal_), std::nullopt, {}};
        if (running_.model) {
            running_.tissue = parameters.make(*running_.model, running_.axis, refusal_);
        }
    }

    /**
     * Whether wanted can be applied, and if not, why. The model is read from its file if reads_model or if there is none yet.
     * Forgets a change that was validated before and not applied.
     */
    bool validate(const AllParameters &wanted, bool reads_model, std::string &why) {
        validated_.reset();
        Made made{wanted, reads_model || !running_.model ? wanted.load(why) : running_.model, std::nullopt, {}};
        if (made.model) {
            made.tissue = wanted.make(*made.model, made.axis, why);
        }
        if (!made.tissue) {
            return false;
        }
        validated_ = std::move(made);
        return true;
    }

    /** Forgets a change that was validated and not applied. */
    void forget() noexcept { validated_.reset(); }

    /** Runs the change that was validated last; false where there is none. */
    bool apply() {
        if (!validated_) {
            return false;
        }
        running_ = *std::move(validated_);
        validated_.reset();
        refusal_.clear();
        return true;
    }

    const AllParameters &parameters() const noexcept { return running_.parameters; }
    const Axis &axis() const noexcept { return running_.axis; }
    /** Null until a model and parameters were accepted. */
    TissueForce *tissue() noexcept { return running_.tissue ? &*running_.tissue : nullptr; }
    const TissueForce *tissue() const noexcept { return running_.tissue ? &*running_.tissue : nullptr; }
    /** Why there is no observer. */
    const std::string &refusal() const noexcept { return refusal_; }

  private:
    struct Made {
        AllParameters parameters;
        /** As it was read; later changes of the file have no effect. */
        std::optional<trocar::Model> model;
        std::optional<TissueForce> tissue;
        Axis axis;
    };

    Made running_;
    std::optional<Made> validated_;
    std::string refusal_;
};

} // namespace trocar_ros

#endif // TROCAR_ROS__SETUP_HPP_
