/*
 * ros2_control: reads a joint and a force-torque sensor, and exports the force on the tissue as state interfaces that other
 * controllers and broadcasters can claim. From ROS 2 Jazzy on. docs/reference/ros2.md has the configuration.
 */
#ifndef TROCAR_ROS__TISSUE_FORCE_BROADCASTER_HPP_
#define TROCAR_ROS__TISSUE_FORCE_BROADCASTER_HPP_

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <controller_interface/chainable_controller_interface.hpp>
#include <hardware_interface/handle.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rclcpp_lifecycle/state.hpp>

#include <trocar_ros/parameters.hpp>
#include <trocar_ros/tissue_force.hpp>

namespace trocar_ros {

/** Those of the observer, and the names of the interfaces claimed. */
struct BroadcasterParameters : Parameters {
    std::string joint = "insertion";
    std::string sensor;

    template <typename Visit> void each(Visit visit) {
        Parameters::each(visit);
        const std::optional<Range> any;
        visit("joint", joint, "Joint along the shaft; claims JOINT/position, m.", any);
        visit("sensor", sensor, "Force-torque sensor; claims SENSOR/force.x, y or z by force_axis, N.", any);
    }
};

class TissueForceBroadcaster : public controller_interface::ChainableControllerInterface {
  public:
    controller_interface::CallbackReturn on_init() override;
    controller_interface::InterfaceConfiguration command_interface_configuration() const override;
    controller_interface::InterfaceConfiguration state_interface_configuration() const override;
    controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State &previous_state) override;
    controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State &previous_state) override;
    controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State &previous_state) override;

  protected:
    std::vector<hardware_interface::StateInterface> on_export_state_interfaces() override;
    std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() override;
    controller_interface::return_type update_reference_from_subscribers(const rclcpp::Time &time,
                                                                        const rclcpp::Duration &period) override;
    controller_interface::return_type update_and_write_commands(const rclcpp::Time &time,
                                                                const rclcpp::Duration &period) override;

  private:
    /** Places of what is exported: those of a force-torque sensor, then its own. */
    enum Exported { kForceX, kForceY, kForceZ, kTorqueX, kTorqueY, kTorqueZ, kVariance, kTrocarForce, kFault, kCount };

    bool read_parameters();
    bool make_observer();
    void export_nothing();

    BroadcasterParameters parameters_;
    std::optional<trocar::Model> model_;
    std::optional<TissueForce> tissue_;
    Axis axis_;
    std::array<double, kCount> values_{};
};

} // namespace trocar_ros

#endif // TROCAR_ROS__TISSUE_FORCE_BROADCASTER_HPP_
