include(stub)
stub_package(rcl_interfaces messages)
set(rcl_interfaces_TARGETS rcl_interfaces::messages)
