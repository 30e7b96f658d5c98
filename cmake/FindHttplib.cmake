include(${CMAKE_CURRENT_LIST_DIR}/PlainLibrary.cmake)
plain_library(Httplib Httplib::Httplib httplib.h cpp-httplib)
if(Httplib_FOUND)  # as Debian compiles it: its types depend on that, and its header calls OpenSSL (0.18)
  target_link_libraries(Httplib::Httplib INTERFACE crypto)
  target_compile_definitions(Httplib::Httplib INTERFACE
    CPPHTTPLIB_OPENSSL_SUPPORT CPPHTTPLIB_ZLIB_SUPPORT CPPHTTPLIB_BROTLI_SUPPORT)
endif()
