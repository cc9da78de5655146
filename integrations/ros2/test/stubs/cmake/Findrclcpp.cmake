include(stub)
stub_package(rclcpp rclcpp)
