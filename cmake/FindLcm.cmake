include(${CMAKE_CURRENT_LIST_DIR}/PlainLibrary.cmake)
plain_library(Lcm Lcm::lcm lcm/lcm.h lcm)
