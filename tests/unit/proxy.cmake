palpate_unit_test(proxy_test proxy_test.cpp CORE palpate::haptics)
