include(stub)
stub_package(diagnostic_msgs messages)
set(diagnostic_msgs_TARGETS diagnostic_msgs::messages)
