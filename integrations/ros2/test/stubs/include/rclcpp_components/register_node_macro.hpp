/* Stub for tests, no ROS 2: see ../../README.md. */
#pragma once

#include <rclcpp/rclcpp.hpp>

/** A component is made from node options alone. */
#define RCLCPP_COMPONENTS_REGISTER_NODE(NodeClass) static_assert(std::is_constructible_v<NodeClass, const rclcpp::NodeOptions &>);
