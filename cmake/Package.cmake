# Debian packages, one for each installed component: the target `package_files`, then cpack. `./tachless
# package` runs both.
#
# To add a component, write COMPONENT name at its install commands. Then add its name to CPACK_COMPONENTS_ALL
# and its own CPACK_DEBIAN_<NAME>_… below tachless_package.
set(files ${PROJECT_BINARY_DIR}/package_files)
get_property(drivers GLOBAL PROPERTY TACHLESS_DRIVERS)
add_custom_target(package_files
  COMMAND ${PROJECT_SOURCE_DIR}/cmake/package_files.sh ${PROJECT_BINARY_DIR}/bin ${files} ${PROJECT_VERSION}
    ${drivers}
  DEPENDS programs VERBATIM)
find_program(JAVAC javac)
find_file(LCM_JAR lcm.jar PATHS /usr/share/java NO_DEFAULT_PATH)
mark_as_advanced(JAVAC LCM_JAR)
if(JAVAC AND LCM_JAR)
  add_dependencies(package_files tachless_types_jar)
endif()
install(DIRECTORY ${files}/share/ DESTINATION share COMPONENT program OPTIONAL)
function(tachless_package component package)
  install(FILES cmake/copyright DESTINATION share/doc/${package} COMPONENT ${component} EXCLUDE_FROM_ALL)
  install(FILES ${files}/changelog.gz DESTINATION share/doc/${package}
    COMPONENT ${component} EXCLUDE_FROM_ALL OPTIONAL)
endfunction()
tachless_package(program tachless)
tachless_package(development libtachless-dev)

if(TARGET python_module)
  tachless_package(python python3-tachless)
  add_dependencies(package_files python_module)
  set(python python)
endif()
if(TARGET mujoco_module)
  tachless_package(mujoco tachless-mujoco)
  set(mujoco mujoco)
endif()
# Each driver of an arm (tachless_driver) has a package of its own.
foreach(driver IN LISTS drivers)
  string(REPLACE "-" "_" component ${driver})
  list(APPEND driver_components ${component})
  tachless_package(${component} ${driver})
  install(DIRECTORY ${files}/${driver}/share DESTINATION . COMPONENT ${component} OPTIONAL)
  string(TOUPPER ${component} upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${driver})
  set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION science)
  set(CPACK_DEBIAN_${upper}_PACKAGE_DEPENDS "tachless (= ${PROJECT_VERSION})")
endforeach()
set(CPACK_DEBIAN_TACHLESS_MIT_CAN_DESCRIPTION "drives with the MIT mode on a CAN bus for tachless
The driver of an arm with Damiao, RobStride or CyberGear drives.")
set(CPACK_DEBIAN_TACHLESS_FRANKA_DESCRIPTION "Franka arms for tachless
The driver of a Franka Research 3, by libfranka.")
set(CPACK_DEBIAN_TACHLESS_UR_DESCRIPTION "arms of Universal Robots for tachless
The driver of an arm with direct_torque, by the maker's client library.")

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "The tachless authors <authors@tachless.invalid>")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_PACKAGE_DIRECTORY ${PROJECT_BINARY_DIR}/../package)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL program development ${python} ${mujoco} ${driver_components})
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME tachless)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAM_DESCRIPTION "robot joints tracked from positions alone
Velocity-free control of rigid and flexible-joint robots, as four processes
on a message bus: a simulated robot, a trajectory generator, a controller
and a logger; with certificates, studies, reports and replay.")
# Packages that the programs call or read, in addition to their linked libraries.
set(CPACK_DEBIAN_PROGRAM_PACKAGE_DEPENDS "libjs-dygraphs, libjs-three")
set(CPACK_DEBIAN_PROGRAM_PACKAGE_RECOMMENDS
  "iproute2, xdg-utils, default-jre, liblcm-java, libjchart2d-java")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libtachless-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_DESCRIPTION "control laws and robot drivers for tachless, in C++
Headers, static libraries and CMake files, for controllers and drivers of
real robots in the place of those of tachless; with an example of each.")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "tachless (= ${PROJECT_VERSION}), libeigen3-dev, libfmt-dev, \
libspdlog-dev, libyaml-cpp-dev, nlohmann-json3-dev, libtinyxml2-dev, libsodium-dev, libnlopt-dev, coinor-libclp-dev")
# A law in a loop of the user's own does without.
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_RECOMMENDS "libsimbody-dev")
# These serve examples/iiwa.
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SUGGESTS "liblcm-dev, liblcm-bin")
set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-tachless)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_DESCRIPTION "robot joints tracked from positions alone, from Python
Control laws as Python functions in the place of tachless's controller;
simulations, recorded runs and a robot's mechanics as arrays.")
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
  "python3 (>= ${Python_VERSION_MAJOR}.${Python_VERSION_MINOR}), python3 (<< ${Python_VERSION_MAJOR}.${PYTHON_NEXT_MINOR}), python3-numpy")
set(CPACK_DEBIAN_PYTHON_PACKAGE_RECOMMENDS "tachless (= ${PROJECT_VERSION}), python3-matplotlib")
set(CPACK_DEBIAN_MUJOCO_PACKAGE_NAME tachless-mujoco)
set(CPACK_DEBIAN_MUJOCO_PACKAGE_SECTION science)
set(CPACK_DEBIAN_MUJOCO_DESCRIPTION "MuJoCo as the simulated robot of tachless
A module that moves the robot of a scenario with plant.mujoco by MuJoCo,
with contact, tables and free bodies.")
set(CPACK_DEBIAN_MUJOCO_PACKAGE_DEPENDS "tachless (= ${PROJECT_VERSION})")
include(CPack)
