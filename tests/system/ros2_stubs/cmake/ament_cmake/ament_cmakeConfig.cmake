macro(ament_package)
endmacro()
