include(stub)
stub_package(hardware_interface hardware_interface)
