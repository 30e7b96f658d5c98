# Installs the files beside programs and libraries (cmake/Tachless.cmake). The programs look for their files
# relative to their own place, in ../share/tachless (core/base/this_process.h). Links to the tree give the
# build directory the same layout.
set(shared share/tachless)
file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/${shared})
file(CREATE_LINK ${PROJECT_SOURCE_DIR}/scenarios ${PROJECT_BINARY_DIR}/${shared}/scenarios SYMBOLIC)
file(CREATE_LINK ${PROJECT_SOURCE_DIR}/examples/project ${PROJECT_BINARY_DIR}/${shared}/project SYMBOLIC)
install(DIRECTORY scenarios examples/project DESTINATION ${shared} COMPONENT program)
install(FILES ${PROJECT_BINARY_DIR}/${shared}/tachless_types.jar DESTINATION ${shared}
  COMPONENT program OPTIONAL)
install(PROGRAMS tools/cli/witness/check_witness.py DESTINATION ${shared}/witness COMPONENT program)
install(FILES tools/cli/witness/interval.py DESTINATION ${shared}/witness COMPONENT program)
install(DIRECTORY docs DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT program)
install(FILES README.md CHANGELOG.md CITATION.cff LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR}
  COMPONENT program)

# The public headers are those of docs/site/cpp.md. They are installed with all headers that they include.
set(headers
  controller/law/law.h controller/law/parts.h controller/law/filter.h controller/program.h
  messages/signals.h messages/measurements.h bus/udp_transport.h
  plant/robot_driver.h plant/drive_loop.h plant/arm_state.h plant/plant_model.h plant/simulator.h plant/node.h session/run_role.h
  base/quantities.h robot/model.h robot/dynamics.h robot/kinematics.h
  scenario/driver_settings.h in_process/in_process_loop.h own_loop/own_loop.h logger/run_log.h)
set(installed_headers)
while(headers)
  list(POP_FRONT headers header)
  if(header IN_LIST installed_headers)
    continue()
  endif()
  list(APPEND installed_headers ${header})
  # An include begins in the root or in a district, as in the include folders of cmake/Tachless.cmake.
  find_file(file ${header} PATHS ${PROJECT_SOURCE_DIR} ${PROJECT_SOURCE_DIR}/core ${PROJECT_SOURCE_DIR}/analysis
    ${PROJECT_BINARY_DIR}/generated NO_DEFAULT_PATH NO_CMAKE_FIND_ROOT_PATH NO_CACHE REQUIRED)
  get_filename_component(folder ${header} DIRECTORY)
  install(FILES ${file} DESTINATION include/tachless/${folder} COMPONENT development)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
  file(STRINGS ${file} includes REGEX "^#include \"")
  list(TRANSFORM includes REPLACE "^#include \"(.+)\".*" "\\1")
  list(APPEND headers ${includes})
  unset(file)
endwhile()
install(DIRECTORY examples/simulate_and_read DESTINATION ${shared}/examples COMPONENT development)
install(DIRECTORY examples/mujoco DESTINATION ${shared}/examples COMPONENT development)
install(DIRECTORY examples/ros2_control DESTINATION ${shared}/examples COMPONENT development)
foreach(example IN ITEMS use_law own_law own_driver own_simulator iiwa)  # each with its robot's URDF, which is a link in the tree
  install(DIRECTORY examples/${example} DESTINATION ${shared}/examples COMPONENT development
    PATTERN *.urdf EXCLUDE)
  set(robot two_link)
  if(example STREQUAL "iiwa")
    set(robot iiwa7)
  endif()
  install(FILES scenarios/robots/${robot}.urdf DESTINATION ${shared}/examples/${example}
    COMPONENT development)
endforeach()
file(GLOB messages lcmtypes/*.lcm)
install(FILES ${messages} DESTINATION ${shared}/lcmtypes COMPONENT development)

# tachless::tachless links the libraries of the headers that docs/site/cpp.md documents.
add_library(tachless_interface INTERFACE)
target_link_libraries(tachless_interface INTERFACE controller logger_runs in_process plant)
set_target_properties(tachless_interface PROPERTIES EXPORT_NAME tachless)
tachless_export(tachless_interface)

include(CMakePackageConfigHelpers)
set(package ${CMAKE_INSTALL_LIBDIR}/cmake/tachless)
configure_package_config_file(cmake/tachlessConfig.cmake.in tachlessConfig.cmake
  INSTALL_DESTINATION ${package})
# 0.x: the headers change with every version.
write_basic_package_version_file(tachlessConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/tachlessConfig.cmake ${PROJECT_BINARY_DIR}/tachlessConfigVersion.cmake
  DESTINATION ${package} COMPONENT development)
install(FILES package.xml DESTINATION ${shared} COMPONENT development)
get_property(libraries GLOBAL PROPERTY TACHLESS_ARCHIVES)
string(REGEX REPLACE "[^/]+" ".." up ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
configure_file(cmake/tachless.pc.in tachless.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/tachless.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)
install(EXPORT tachless NAMESPACE tachless:: FILE tachlessTargets.cmake DESTINATION ${package}
  COMPONENT development)
