include(stub)
stub_package(geometry_msgs messages)
set(geometry_msgs_TARGETS geometry_msgs::messages)
