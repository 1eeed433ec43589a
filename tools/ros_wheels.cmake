# Read by every project(): -DCMAKE_PROJECT_INCLUDE=<this file>. What building against ROS's wheels needs
# that building against its packages does not; done once the project's own CMakeLists.txt has been read.
if(NOT PROJECT_SOURCE_DIR STREQUAL CMAKE_SOURCE_DIR)
  return()
endif()

# The wheels' <pkg>__rosidl_generator_py targets name the include folders of the machine they were built
# on (/opt/python/cpXY-cpXY/...): name this interpreter's instead.
function(ros_wheels_fix_paths)
  get_property(targets DIRECTORY "${CMAKE_SOURCE_DIR}" PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(dirs ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(dirs MATCHES "/opt/python/cp")
      list(FILTER dirs EXCLUDE REGEX "^/opt/python/cp")
      list(APPEND dirs ${Python3_INCLUDE_DIRS} ${Python3_NumPy_INCLUDE_DIRS})
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${dirs}")
    endif()
  endforeach()
endfunction()

# The C++ files that are generated for the messages of a package include nearly the same headers, which
# take most of the time to compile: compiled together they take a quarter. (Those of introspection_cpp
# specialise what another of them has instantiated, and cannot be.)
function(ros_wheels_compile_together)
  get_property(targets DIRECTORY "${CMAKE_SOURCE_DIR}" PROPERTY BUILDSYSTEM_TARGETS)
  foreach(target IN LISTS targets)
    if(target MATCHES "__rosidl_typesupport_(cpp|fastrtps_c|fastrtps_cpp)$")
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 16)
    endif()
  endforeach()
endfunction()

cmake_language(DEFER DIRECTORY "${CMAKE_SOURCE_DIR}" CALL ros_wheels_fix_paths)
cmake_language(DEFER DIRECTORY "${CMAKE_SOURCE_DIR}" CALL ros_wheels_compile_together)
