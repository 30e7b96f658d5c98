include(${CMAKE_CURRENT_LIST_DIR}/PlainLibrary.cmake)
plain_library(Clp Clp::Clp coin/Clp_C_Interface.h Clp)
