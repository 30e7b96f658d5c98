// The sources that refused_lines.py compiles.
#include "flexible_law_reads_motor_velocity.cpp"
#include "flexible_position_law_reads_velocity.cpp"
#include "output_feedback_law_reads_velocity.cpp"
#include "state_is_no_motor_position_measurement.cpp"
#include "state_is_no_position_measurement.cpp"
#include "state_law_claims_output_feedback.cpp"
