palpate_unit_test(security_token_test security_token_test.cpp CORE palpate::security)
palpate_unit_test(security_limits_test security_limits_test.cpp CORE palpate::security)
palpate_unit_test(connection_limits_test connection_limits_test.cpp CORE palpate::security)
palpate_unit_test(security_certificates_test security_certificates_test.cpp
  CORE palpate::security)
palpate_unit_test(security_methods_test security_methods_test.cpp palpate::security palpate::proto)
