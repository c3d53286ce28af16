palpate_unit_test(proxy_test proxy_test.cpp SANITIZED palpate::haptics)
