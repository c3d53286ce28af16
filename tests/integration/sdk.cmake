foreach(test sdk_connection_test sdk_pose_test sdk_security_test sdk_settings_test
        sdk_volume_test)
  palpate_integration_test(${test} ${test}.cpp palpate::client)
  add_dependencies(${test} palpated)
  target_compile_definitions(${test} PRIVATE PALPATED="$<TARGET_FILE:palpated>")
endforeach()
# A stream without the library, to compare with; a server that is not palpated.
target_link_libraries(sdk_pose_test PRIVATE palpate::proto)
target_link_libraries(sdk_security_test PRIVATE palpate::proto)

find_package(Python3 REQUIRED COMPONENTS Interpreter)
add_test(NAME integration.sdk_install
  COMMAND Python3::Interpreter ${CMAKE_CURRENT_LIST_DIR}/sdk_install_test.py
    ${PROJECT_BINARY_DIR} ${PROJECT_SOURCE_DIR} $<TARGET_FILE:palpated> ${CMAKE_COMMAND}
    ${CMAKE_CXX_COMPILER})
set_tests_properties(integration.sdk_install PROPERTIES LABELS integration TIMEOUT 600)
if(PALPATE_SANITIZE)
  set_tests_properties(integration.sdk_install PROPERTIES ENVIRONMENT
    "CXXFLAGS=-fsanitize=${PALPATE_SANITIZE};LDFLAGS=-fsanitize=${PALPATE_SANITIZE}")
endif()
