include(stub)
stub_package(rclcpp_lifecycle rclcpp_lifecycle)
