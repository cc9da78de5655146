/*
 * The parameters of the node, the broadcaster and the dVRK component: each once, with its name, description and range.
 * Knows nothing of ROS.
 */
#ifndef TROCAR_ROS__PARAMETERS_HPP_
#define TROCAR_ROS__PARAMETERS_HPP_

#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include <trocar_ros/axis.hpp>
#include <trocar_ros/tissue_force.hpp>

namespace trocar_ros {

/** Least and largest value of a parameter. */
struct Range {
    double from;
    double to;
};

/** Which model, and how sensor and joint are mounted. NaN stands for the value in the model file. */
struct Parameters {
    std::string model_path;
    std::string force_axis = "z";
    std::string flip_force = "model";
    bool invert_position = false;
    bool adaptation = true;
    double longest_interval_s = Settings{}.longest_interval_s;
    double force_error_n = std::numeric_limits<double>::quiet_NaN();
    double offset_n = std::numeric_limits<double>::quiet_NaN();
    double moving_mass_kg = std::numeric_limits<double>::quiet_NaN();
    double gravity_m_s2 = 0.0;
    double sensor_limit_n = std::numeric_limits<double>::quiet_NaN();

    /** visit(name, value, description, range) for each. */
    template <typename Visit> void each(Visit visit) {
        const std::optional<Range> any;
        visit("model_path", model_path, "Identified model (model.json). Read when set; setting it again reads it again.", any);
        visit("force_axis", force_axis,
              "Axis of the sensor along the shaft that points in the direction of insertion, as for the recordings of the model: x, "
              "y, z, -x, -y or -z.",
              any);
        visit("flip_force", flip_force,
              "Whether the sign of the readings is reversed, as for a sensor that reports the reaction: model (as the recordings "
              "of the model were), yes or no.",
              any);
        visit("invert_position", invert_position, "Whether the position of the joint falls on insertion.", any);
        visit("adaptation", adaptation, "Whether friction and viscosity are adapted in use.", any);
        visit("longest_interval_s", longest_interval_s,
              "Longest interval between two wrenches across which one is interpolated, and longest wait for a wrench, s.",
              std::optional<Range>({1e-4, kLongestInterval_s}));
        // No range in those that may be NaN: newer releases of rclcpp refuse NaN where there is one. The observer checks them.
        visit("force_error_n", force_error_n, "Standard deviation of the model's force, N, 0 or more; NaN: as in the model file.",
              any);
        visit("offset_n", offset_n, "Reading without any force, N; NaN: as in the model file, else 0.", any);
        visit("moving_mass_kg", moving_mass_kg, "Mass between sensor and seal, kg, 0 or more; NaN: as in the model file, else 0.",
              any);
        visit("gravity_m_s2", gravity_m_s2,
              "Gravity along the insertion as it acts on the reading of that mass, m/s^2; 0 leaves the weight in the offset.",
              std::optional<Range>({-20.0, 20.0}));
        visit("sensor_limit_n", sensor_limit_n, "Largest force that the sensor can read, N, above 0; NaN: none is known.",
              any);
    }

    /** The model of model_path; nothing where there is none, and why. */
    std::optional<trocar::Model> load(std::string &why) const {
        if (model_path.empty()) {
            why = "model_path is empty: set it to the model.json of an identified trocar";
            return std::nullopt;
        }
        trocar::Refusal refusal;
        std::optional<trocar::Model> model = trocar::Model::try_load(model_path, &refusal);
        why = model ? why : refusal.text;
        return model;
    }

    /** The observer that they describe, and along which axis the force is; nothing where one is refused, and why. */
    std::optional<TissueForce> make(const trocar::Model &model, Axis &axis, std::string &why) const {
        const std::optional<Axis> parsed = Axis::parse(force_axis);
        if (!parsed) {
            why = "force_axis must be x, y, z, -x, -y or -z, got \"" + force_axis + "\"";
            return std::nullopt;
        }
        if (flip_force != "model" && flip_force != "yes" && flip_force != "no") {
            why = "flip_force must be model, yes or no, got \"" + flip_force + "\"";
            return std::nullopt;
        }
        Settings settings;
        settings.longest_interval_s = longest_interval_s;
        settings.compensator.adaptation = adaptation;
        if (flip_force != "model") {
            settings.compensator.flip_force = flip_force == "yes";
        }
        settings.compensator.gravity_m_s2 = gravity_m_s2;
        settings.compensator.force_error_n = given(force_error_n);
        settings.compensator.offset_n = given(offset_n);
        settings.compensator.moving_mass_kg = given(moving_mass_kg);
        settings.compensator.sensor_limit_n = given(sensor_limit_n);
        trocar::Refusal refusal;
        std::optional<TissueForce> tissue = TissueForce::try_make(model, settings, &refusal);
        if (!tissue) {
            why = refusal.text;
        } else {
            axis = *parsed;
        }
        return tissue;
    }

  private:
    static std::optional<double> given(double value) {
        return value == value ? std::optional<double>(value) : std::nullopt;
    }
};

/** Those of the observer, and those of the topics of the node. */
struct NodeParameters : Parameters {
    std::string joint = "insertion";
    std::string frame_id;
    bool use_arrival_time = false;
    double stale_after_s = 0.5;

    template <typename Visit> void each(Visit visit) {
        Parameters::each(visit);
        const std::optional<Range> any;
        visit("joint", joint, "Joint along the shaft, by its name in the joint state; its position is in m.", any);
        visit("frame_id", frame_id, "Frame of what is published; empty: that of the wrench received.", any);
        visit("use_arrival_time", use_arrival_time,
              "Whether messages count from when they arrive rather than by header.stamp: for topics stamped by two clocks.",
              any);
        visit("stale_after_s", stale_after_s, "A topic without a message for so long is reported as stale, s.",
              std::optional<Range>({0.05, 60.0}));
    }

    /** As Parameters::make(); also refuses what only the node has. */
    std::optional<TissueForce> make(const trocar::Model &model, Axis &axis, std::string &why) const {
        if (!std::isfinite(stale_after_s)) {
            why = "stale_after_s must be finite";
            return std::nullopt;
        }
        return Parameters::make(model, axis, why);
    }
};

} // namespace trocar_ros

#endif // TROCAR_ROS__PARAMETERS_HPP_
