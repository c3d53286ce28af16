# The USB link and device against emulated ones in the same process: umockdev's library
# is linked before the C library, whose calls it takes, so that nothing is preloaded.
find_library(UMOCKDEV_PRELOAD umockdev-preload REQUIRED)
foreach(test usb_link_test usb_device_test)
  palpate_integration_test(${test} ${test}.cpp palpate::usb usb_emulator
    -Wl,--no-as-needed ${UMOCKDEV_PRELOAD} -Wl,--as-needed)
endforeach()
palpate_integration_test(omni_usb_device_test omni_usb_device_test.cpp palpate::omni_usb palpate::usb
  usb_emulator -Wl,--no-as-needed ${UMOCKDEV_PRELOAD} -Wl,--as-needed)
