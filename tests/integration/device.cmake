# Emulated USB devices: see tests/support/usb_testbed.h.
find_package(PkgConfig REQUIRED)
pkg_check_modules(LIBUSB REQUIRED IMPORTED_TARGET libusb-1.0)
pkg_check_modules(UMOCKDEV REQUIRED IMPORTED_TARGET umockdev-1.0)
set(support ${PROJECT_SOURCE_DIR}/tests/support)
add_library(usb_emulator STATIC ${support}/falcon_emulator.cpp ${support}/touch_emulator.cpp
  ${support}/usb_emulator.cpp ${support}/usb_port.cpp ${support}/usb_testbed.cpp)
target_link_libraries(usb_emulator PUBLIC palpate::omni palpate::geometry PkgConfig::UMOCKDEV)

add_executable(usb_client_child usb_client_child.cpp)
target_link_libraries(usb_client_child PRIVATE PkgConfig::LIBUSB)
set_target_properties(usb_client_child PROPERTIES
  RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
palpate_integration_test(usb_emulator_test usb_emulator_test.cpp usb_emulator)
add_dependencies(usb_emulator_test usb_client_child)
target_compile_definitions(usb_emulator_test PRIVATE
  USB_CLIENT_CHILD="$<TARGET_FILE:usb_client_child>")

foreach(test device_usb_test device_faults_test device_falcon_test)
  # The emulated bus is a thread like others, and must keep up with 1 kHz.
  palpate_integration_test(${test} ${test}.cpp ALONE usb_emulator palpate::proto)
  add_dependencies(${test} palpated)
  target_compile_definitions(${test} PRIVATE PALPATED="$<TARGET_FILE:palpated>")
endforeach()
target_link_libraries(device_falcon_test PRIVATE palpate::falcon_codec)
