# The CMake exports of the ROS 2 wheels on PyPI name include folders of the image that they were built in, and CMake
# refuses imported targets whose include folders do not exist. This drops such folders at the end of configuring.
# Use: cmake -DCMAKE_PROJECT_INCLUDE=<this file>. With ROS from apt there is nothing to drop, and it changes nothing.

function(drop_missing_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT directories)
      continue()
    endif()
    set(present)
    foreach(directory IN LISTS directories)
      if(directory MATCHES "^\\$<" OR EXISTS "${directory}")
        list(APPEND present "${directory}")
      endif()
    endforeach()
    set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${present}")
  endforeach()
endfunction()

cmake_language(DEFER CALL drop_missing_include_directories)
