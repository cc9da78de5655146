include(stub)
stub_package(sensor_msgs messages)
set(sensor_msgs_TARGETS sensor_msgs::messages)
