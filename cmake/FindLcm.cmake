# LCM as Debian packages it, which is without a CMake file. Target: Lcm::lcm.
find_path(LCM_INCLUDE_DIR lcm/lcm.h)
find_library(LCM_LIBRARY lcm)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Lcm DEFAULT_MSG LCM_LIBRARY LCM_INCLUDE_DIR)
if(Lcm_FOUND AND NOT TARGET Lcm::lcm)
  add_library(Lcm::lcm UNKNOWN IMPORTED)
  set_target_properties(Lcm::lcm PROPERTIES
    IMPORTED_LOCATION ${LCM_LIBRARY} INTERFACE_INCLUDE_DIRECTORIES ${LCM_INCLUDE_DIR})
endif()
mark_as_advanced(LCM_INCLUDE_DIR LCM_LIBRARY)
