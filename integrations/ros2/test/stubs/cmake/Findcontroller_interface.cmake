include(stub)
stub_package(controller_interface controller_interface)
set(controller_interface_VERSION 4.0.0)
