# palpate_python_classes(OUT FILE): the classes of FILE that have tests of their own, in order.
# Each becomes a test for ctest where a file mostly waits: they run beside each other, and a class
# that is added is run without being named here.
function(palpate_python_classes out file)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
  file(STRINGS ${file} lines REGEX "^class |^    def test_")
  set(classes "")
  foreach(line IN LISTS lines)
    if(line MATCHES "^class ([A-Za-z0-9]+)")
      set(class ${CMAKE_MATCH_1})
    else()
      list(APPEND classes ${class})
    endif()
  endforeach()
  list(REMOVE_DUPLICATES classes)
  set(${out} ${classes} PARENT_SCOPE)
endfunction()
