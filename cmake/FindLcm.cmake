# LCM as Debian packages it, which is without a CMake file. Targets: Lcm::lcm, Lcm::lcm-gen;
# variable LCM_JAR.
find_path(LCM_INCLUDE_DIR lcm/lcm.h)
find_library(LCM_LIBRARY lcm)
find_program(LCM_GEN lcm-gen)
find_file(LCM_JAR lcm.jar PATHS /usr/share/java)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Lcm DEFAULT_MSG LCM_LIBRARY LCM_INCLUDE_DIR LCM_GEN LCM_JAR)
if(Lcm_FOUND AND NOT TARGET Lcm::lcm)
  add_library(Lcm::lcm UNKNOWN IMPORTED)
  set_target_properties(Lcm::lcm PROPERTIES
    IMPORTED_LOCATION ${LCM_LIBRARY} INTERFACE_INCLUDE_DIRECTORIES ${LCM_INCLUDE_DIR})
  add_executable(Lcm::lcm-gen IMPORTED)
  set_target_properties(Lcm::lcm-gen PROPERTIES IMPORTED_LOCATION ${LCM_GEN})
endif()
mark_as_advanced(LCM_INCLUDE_DIR LCM_LIBRARY LCM_GEN LCM_JAR)
