# The node and the broadcaster.
find_package(ament_cmake REQUIRED)
foreach(package rclcpp rclcpp_components rcl_interfaces diagnostic_msgs geometry_msgs sensor_msgs
        controller_interface hardware_interface pluginlib rclcpp_lifecycle)
    find_package(${package} REQUIRED)
endforeach()

add_library(trocar_ros_node SHARED src/tissue_force_node.cpp)
target_link_libraries(trocar_ros_node PUBLIC core rclcpp::rclcpp rclcpp_components::component
    ${rcl_interfaces_TARGETS} ${diagnostic_msgs_TARGETS} ${geometry_msgs_TARGETS} ${sensor_msgs_TARGETS})
rclcpp_components_register_node(trocar_ros_node PLUGIN "trocar_ros::TissueForceNode" EXECUTABLE tissue_force)

set(libraries core trocar_ros_node)
# on_export_state_interfaces() came with ros2_control 4.13, get_optional() with 4.27 (ROS 2 Jazzy).
if(controller_interface_VERSION VERSION_LESS 4.27)
    message(WARNING "no broadcaster: it needs ros2_control 4.27, found ${controller_interface_VERSION}; the node does not")
else()
    add_library(trocar_ros_broadcaster SHARED src/tissue_force_broadcaster.cpp)
    target_link_libraries(trocar_ros_broadcaster PUBLIC core rclcpp::rclcpp rclcpp_lifecycle::rclcpp_lifecycle
        controller_interface::controller_interface hardware_interface::hardware_interface pluginlib::pluginlib
        ${rcl_interfaces_TARGETS})
    pluginlib_export_plugin_description_file(controller_interface trocar_ros_plugins.xml)
    list(APPEND libraries trocar_ros_broadcaster)
endif()

install(TARGETS ${libraries} EXPORT ${PROJECT_NAME}Targets
    LIBRARY DESTINATION lib ARCHIVE DESTINATION lib RUNTIME DESTINATION bin)
install(DIRECTORY include/ DESTINATION include)
install(DIRECTORY config launch DESTINATION share/${PROJECT_NAME})
ament_export_targets(${PROJECT_NAME}Targets HAS_LIBRARY_TARGET)
ament_export_dependencies(trocar rclcpp rclcpp_components rcl_interfaces diagnostic_msgs geometry_msgs sensor_msgs
    controller_interface hardware_interface pluginlib rclcpp_lifecycle)
