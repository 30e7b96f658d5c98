add_library(controller_interface::controller_interface INTERFACE IMPORTED)
target_include_directories(controller_interface::controller_interface INTERFACE ${CMAKE_CURRENT_LIST_DIR}/../../include)
