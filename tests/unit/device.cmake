palpate_unit_test(simulated_device_test simulated_device_test.cpp SANITIZED palpate::device)
palpate_unit_test(omni_test omni_test.cpp SANITIZED palpate::omni)
