# Imported targets are known only where they were found.
find_package(fmt REQUIRED)
find_package(nlohmann_json REQUIRED)

palpate_unit_test(cli_test cli_test.cpp palpate::cli)
palpate_unit_test(cli_device_test cli_device_test.cpp palpate::cli)
target_compile_definitions(cli_device_test PRIVATE PALPATE_EXECUTABLE="$<TARGET_FILE:palpate>")
add_dependencies(cli_device_test palpate)
palpate_unit_test(cli_setting_test cli_setting_test.cpp palpate::cli palpate::haptics fmt::fmt)

# Runs the program itself against a server in the test.
palpate_unit_test(cli_fake_daemon_test cli_fake_daemon_test.cpp palpate::wire
  nlohmann_json::nlohmann_json)
target_compile_definitions(cli_fake_daemon_test PRIVATE
  PALPATE_EXECUTABLE="$<TARGET_FILE:palpate>")
add_dependencies(cli_fake_daemon_test palpate)
