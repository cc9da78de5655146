/* Stub for tests, no ROS 2: see ../../README.md. Follows controller_interface/chainable_controller_interface.hpp of ros2_control
 * 4.27.0 (ROS 2 Jazzy). */
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <hardware_interface/handle.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rclcpp_lifecycle/state.hpp>

namespace controller_interface {

enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };

struct InterfaceConfiguration {
    interface_configuration_type type;
    std::vector<std::string> names = {};
};

class ChainableControllerInterface {
  public:
    virtual ~ChainableControllerInterface() = default;

    virtual InterfaceConfiguration command_interface_configuration() const = 0;
    virtual InterfaceConfiguration state_interface_configuration() const = 0;
    virtual CallbackReturn on_init() = 0;
    virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }

    return_type update(const rclcpp::Time &time, const rclcpp::Duration &period) {
        const return_type done = update_reference_from_subscribers(time, period);
        return done == return_type::OK ? update_and_write_commands(time, period) : done;
    }

    /** The lifecycle node of ros2_control; here a plain one. */
    std::shared_ptr<rclcpp::Node> get_node() const { return node_; }

    /** For tests: what the controller manager does. */
    void give_node(std::shared_ptr<rclcpp::Node> node) { node_ = std::move(node); }
    void assign(std::vector<hardware_interface::LoanedStateInterface> states) { state_interfaces_ = std::move(states); }
    std::vector<hardware_interface::LoanedStateInterface> &assigned() { return state_interfaces_; }
    std::vector<hardware_interface::StateInterface> exported() { return on_export_state_interfaces(); }

  protected:
    virtual std::vector<hardware_interface::StateInterface> on_export_state_interfaces() { return {}; }
    virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() { return {}; }
    virtual return_type update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &) = 0;
    virtual return_type update_and_write_commands(const rclcpp::Time &, const rclcpp::Duration &) = 0;

    std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;

  private:
    std::shared_ptr<rclcpp::Node> node_;
};

} // namespace controller_interface
