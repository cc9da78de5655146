/*
 * Parameters as those of a ROS 2 node.
 */
#ifndef TROCAR_ROS__DECLARE_HPP_
#define TROCAR_ROS__DECLARE_HPP_

#include <optional>

#include <rcl_interfaces/msg/floating_point_range.hpp>
#include <rcl_interfaces/msg/parameter_descriptor.hpp>

#include <trocar_ros/parameters.hpp>

namespace trocar_ros {

/**
 * Declares every parameter on a node, and takes the values that were given at its start. The nodes of controllers have
 * declared those given already. Throws what rclcpp throws for a value of another type or out of range.
 */
template <typename Node, typename AllParameters> void declare(Node &node, AllParameters &parameters) {
    parameters.each([&](const char *name, auto &value, const char *description, const std::optional<Range> &range) {
        if (node.has_parameter(name)) {
            node.get_parameter(name, value);
            return;
        }
        rcl_interfaces::msg::ParameterDescriptor descriptor;
        descriptor.description = description;
        if (range) {
            rcl_interfaces::msg::FloatingPointRange limits;
            limits.from_value = range->from;
            limits.to_value = range->to;
            descriptor.floating_point_range.push_back(limits);
        }
        value = node.declare_parameter(name, value, descriptor);
    });
}

} // namespace trocar_ros

#endif // TROCAR_ROS__DECLARE_HPP_
