palpate_unit_test(simulated_device_test simulated_device_test.cpp CORE palpate::device)
palpate_unit_test(omni_test omni_test.cpp CORE palpate::omni)
palpate_unit_test(device_log_test device_log_test.cpp CORE palpate::usb)
palpate_unit_test(falcon_frames_test falcon_frames_test.cpp CORE palpate::falcon_codec)
palpate_unit_test(falcon_kinematics_test falcon_kinematics_test.cpp CORE palpate::falcon_codec)
# In place of the transport.
add_library(palpate_scripted_usb_link STATIC
  ${PROJECT_SOURCE_DIR}/tests/support/scripted_usb_link.cpp)
target_link_libraries(palpate_scripted_usb_link PUBLIC palpate::geometry)
palpate_unit_test(falcon_protocol_test falcon_protocol_test.cpp CORE
  palpate::falcon palpate_scripted_usb_link)
palpate_unit_test(omni_usb_frames_test omni_usb_frames_test.cpp CORE palpate::omni)
palpate_unit_test(omni_usb_protocol_test omni_usb_protocol_test.cpp CORE
  palpate::omni_usb palpate_scripted_usb_link)
palpate_unit_test(omni_usb_setup_test omni_usb_setup_test.cpp CORE
  palpate::omni_usb palpate_scripted_usb_link)

# Captures of real devices.
find_package(PkgConfig REQUIRED)
pkg_check_modules(PCAP REQUIRED IMPORTED_TARGET libpcap)
palpate_unit_test(capture_test capture_test.cpp CORE palpate::omni_usb
  palpate_scripted_usb_link PkgConfig::PCAP)
target_sources(capture_test PRIVATE ../support/usb_capture.cpp)
target_compile_definitions(capture_test PRIVATE
  PALPATE_CAPTURES_DIR="${CMAKE_SOURCE_DIR}/tests/data/captures")

find_package(Python3 REQUIRED COMPONENTS Interpreter)
add_test(NAME unit.udev_rules
  COMMAND Python3::Interpreter ${CMAKE_CURRENT_SOURCE_DIR}/udev_rules_test.py)
set_tests_properties(unit.udev_rules PROPERTIES LABELS unit)

# An HD library of our own, whole and without one of its functions.
foreach(variant libHD libHD-missing)
  add_library(fake-${variant} MODULE ${PROJECT_SOURCE_DIR}/tests/support/fake_hd.cpp)
  set_target_properties(fake-${variant} PROPERTIES PREFIX "" OUTPUT_NAME ${variant}
    LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
endforeach()
target_compile_definitions(fake-libHD-missing PRIVATE PALPATE_FAKE_HD_MISSING)
palpate_unit_test(openhaptics_test openhaptics_test.cpp CORE palpate::openhaptics
  ${CMAKE_DL_LIBS})
add_dependencies(openhaptics_test fake-libHD fake-libHD-missing)
target_compile_definitions(openhaptics_test PRIVATE
  PALPATE_FAKE_HD="$<TARGET_FILE:fake-libHD>"
  PALPATE_FAKE_HD_MISSING_PATH="$<TARGET_FILE:fake-libHD-missing>")
palpate_unit_test(openhaptics_frame_test openhaptics_frame_test.cpp CORE palpate::openhaptics)
palpate_unit_test(replay_device_test replay_device_test.cpp CORE palpate::device)
