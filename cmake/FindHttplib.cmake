# From 0.18 on its header calls OpenSSL.
include(${CMAKE_CURRENT_LIST_DIR}/PlainLibrary.cmake)
plain_library(Httplib Httplib::Httplib httplib.h cpp-httplib)
if(Httplib_FOUND)  # with what Debian compiles it with: its types depend on it
  target_link_libraries(Httplib::Httplib INTERFACE crypto)
  target_compile_definitions(Httplib::Httplib INTERFACE
    CPPHTTPLIB_OPENSSL_SUPPORT CPPHTTPLIB_ZLIB_SUPPORT CPPHTTPLIB_BROTLI_SUPPORT)
endif()
