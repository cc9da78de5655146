# Makes PACKAGE found, with the targets that its users link; header only. TROCAR_STUB_MESSAGES is the folder of messages.py.
function(stub_package package)
    foreach(target ${ARGN})
        if(NOT TARGET ${package}::${target})
            add_library(${package}::${target} INTERFACE IMPORTED)
            target_include_directories(${package}::${target} INTERFACE
                "${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../include" "${TROCAR_STUB_MESSAGES}")
        endif()
    endforeach()
    set(${package}_FOUND TRUE PARENT_SCOPE)
endfunction()
