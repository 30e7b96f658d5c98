#pragma once

// The stand-in's loader calls this function of the plugin.
#define PLUGINLIB_EXPORT_CLASS(Class, Base) \
  extern "C" Base* new_controller() { return new Class; }
