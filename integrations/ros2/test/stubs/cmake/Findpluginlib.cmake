include(stub)
stub_package(pluginlib pluginlib)
function(pluginlib_export_plugin_description_file)
endfunction()
