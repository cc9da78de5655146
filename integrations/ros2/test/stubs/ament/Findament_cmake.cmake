# Where ament_cmake itself is missing: installs the targets for find_package, and nothing else.
function(ament_export_targets targets)
    install(EXPORT ${targets} FILE ${PROJECT_NAME}Config.cmake NAMESPACE ${PROJECT_NAME}::
        DESTINATION share/${PROJECT_NAME}/cmake)
endfunction()
function(ament_export_dependencies)
endfunction()
function(ament_package)
endfunction()
set(ament_cmake_FOUND TRUE)
