# For libraries that Debian packages without a CMake file.
include(FindPackageHandleStandardArgs)
macro(plain_library NAME TARGET HEADER LIBRARY)
  find_path(${NAME}_INCLUDE_DIR ${HEADER})
  find_library(${NAME}_LIBRARY ${LIBRARY})
  find_package_handle_standard_args(${NAME} DEFAULT_MSG ${NAME}_LIBRARY ${NAME}_INCLUDE_DIR)
  if(${NAME}_FOUND AND NOT TARGET ${TARGET})
    add_library(${TARGET} UNKNOWN IMPORTED)
    set_target_properties(${TARGET} PROPERTIES IMPORTED_LOCATION ${${NAME}_LIBRARY}
      INTERFACE_INCLUDE_DIRECTORIES ${${NAME}_INCLUDE_DIR})
  endif()
  mark_as_advanced(${NAME}_INCLUDE_DIR ${NAME}_LIBRARY)
endmacro()
