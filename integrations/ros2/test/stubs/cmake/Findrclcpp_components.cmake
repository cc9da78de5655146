include(stub)
stub_package(rclcpp_components component)
# The program that the real one makes needs rclcpp itself.
function(rclcpp_components_register_node)
endfunction()
