# cpp-httplib as Debian builds it, with a pkg-config file alone. Target: Httplib::Httplib.
find_path(HTTPLIB_INCLUDE_DIR httplib.h)
find_library(HTTPLIB_LIBRARY cpp-httplib)
find_library(HTTPLIB_CRYPTO_LIBRARY crypto)  # from 0.18 on its header calls OpenSSL
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Httplib DEFAULT_MSG
  HTTPLIB_LIBRARY HTTPLIB_CRYPTO_LIBRARY HTTPLIB_INCLUDE_DIR)
if(Httplib_FOUND AND NOT TARGET Httplib::Httplib)
  add_library(Httplib::Httplib UNKNOWN IMPORTED)
  # With what the library is compiled with: its types depend on it.
  set_target_properties(Httplib::Httplib PROPERTIES
    IMPORTED_LOCATION ${HTTPLIB_LIBRARY} INTERFACE_INCLUDE_DIRECTORIES ${HTTPLIB_INCLUDE_DIR}
    INTERFACE_LINK_LIBRARIES ${HTTPLIB_CRYPTO_LIBRARY}
    INTERFACE_COMPILE_DEFINITIONS
      "CPPHTTPLIB_OPENSSL_SUPPORT;CPPHTTPLIB_ZLIB_SUPPORT;CPPHTTPLIB_BROTLI_SUPPORT")
endif()
mark_as_advanced(HTTPLIB_INCLUDE_DIR HTTPLIB_LIBRARY HTTPLIB_CRYPTO_LIBRARY)
