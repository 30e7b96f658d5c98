add_library(pluginlib::pluginlib INTERFACE IMPORTED)
target_include_directories(pluginlib::pluginlib INTERFACE ${CMAKE_CURRENT_LIST_DIR}/../../include)
function(pluginlib_export_plugin_description_file)
endfunction()
