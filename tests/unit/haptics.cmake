palpate_unit_test(visual_proxy_test visual_proxy_test.cpp SANITIZED palpate::haptics)
palpate_unit_test(effects_test effects_test.cpp SANITIZED palpate::haptics)
palpate_unit_test(renderer_test renderer_test.cpp SANITIZED palpate::haptics)
palpate_unit_test(safety_test safety_test.cpp SANITIZED palpate::servo)
