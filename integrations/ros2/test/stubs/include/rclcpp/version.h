/* Stub for tests, no ROS 2: see ../../README.md. */
#pragma once

/* 28 as in Jazzy; 16 as in Humble. */
#ifndef RCLCPP_STUB_MAJOR
#define RCLCPP_STUB_MAJOR 28
#endif

#define RCLCPP_VERSION_GTE(major, minor, patch) (RCLCPP_STUB_MAJOR >= (major))
