# What a service is: its configuration, its health, its workstation.
find_package(fmt REQUIRED)
palpate_unit_test(service_manager_test service_manager_test.cpp palpate::app)
palpate_unit_test(thread_stacks_test thread_stacks_test.cpp palpate::app)
palpate_unit_test(process_test process_test.cpp)
find_package(Python3 REQUIRED COMPONENTS Interpreter)
add_test(NAME unit.crash
  COMMAND Python3::Interpreter ${CMAKE_CURRENT_SOURCE_DIR}/crash_test.py)
set_tests_properties(unit.crash PROPERTIES LABELS unit)
palpate_unit_test(config_check_test config_check_test.cpp palpate::app)
palpate_unit_test(config_reload_test config_reload_test.cpp palpate::app)
palpate_unit_test(doctor_checks_test doctor_checks_test.cpp CORE palpate::doctor)
