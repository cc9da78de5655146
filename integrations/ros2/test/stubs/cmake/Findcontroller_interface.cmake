include(stub)
stub_package(controller_interface controller_interface)
# The oldest release that has what the broadcaster uses; the check also tries an older one.
if(NOT TROCAR_STUB_ROS2_CONTROL)
    set(TROCAR_STUB_ROS2_CONTROL 4.27.0)
endif()
set(controller_interface_VERSION ${TROCAR_STUB_ROS2_CONTROL})
