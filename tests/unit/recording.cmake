palpate_unit_test(recording_format_test recording_format_test.cpp CORE palpate::recording)
palpate_unit_test(recorder_test recorder_test.cpp CORE palpate::recording)
palpate_unit_test(recording_csv_test recording_csv_test.cpp CORE palpate::recording)
palpate_unit_test(recording_replay_test recording_replay_test.cpp CORE palpate::recording)

add_executable(recording_child recording_child.cpp)
target_link_libraries(recording_child PRIVATE palpate::recording)
set_target_properties(recording_child PROPERTIES
  RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
palpate_unit_test(recording_file_test recording_file_test.cpp CORE palpate::recording)
add_dependencies(recording_file_test recording_child)
target_compile_definitions(recording_file_test PRIVATE
  RECORDING_CHILD="$<TARGET_FILE:recording_child>")
palpate_unit_test(servo_keyframe_test servo_keyframe_test.cpp CORE palpate::recording)
palpate_unit_test(recording_edit_test recording_edit_test.cpp CORE palpate::recording)
palpate_unit_test(shown_samples_test shown_samples_test.cpp CORE palpate::recording)
palpate_unit_test(recording_control_test recording_control_test.cpp CORE palpate::recording)
palpate_unit_test(black_box_test black_box_test.cpp CORE palpate::recording)
palpate_unit_test(recorded_path_test recorded_path_test.cpp CORE palpate::recording)
