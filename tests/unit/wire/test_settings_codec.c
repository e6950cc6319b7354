/* SPDX-License-Identifier: Apache-2.0 */
/* Each setting of a query (base/query_settings.h) must be the field of QueryRequest with the same
 * name. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdbool.h>
#include <string.h>

#include "base/query_settings.h"
#include "umbrage/v1/shadows.pb-c.h"
#include "wire_samples.h"

/* Writes a value that is within every range, and is not 0. */
static void give(const struct umb__setting *setting, struct umb_query_settings *settings)
{
    const double numbers[3] = {setting->most > 0 ? setting->most / 2 : 1, 2, 3};
    const uint32_t whole = setting->kind == UMB__SETTING_ODD ? 3 : 1;
    const bool is_number = setting->kind == UMB__SETTING_NUMBER;
    void *at = (uint8_t *)settings + setting->at;
    if (is_number || setting->kind == UMB__SETTING_NUMBERS) {
        memcpy(at, numbers, is_number ? sizeof numbers[0] : sizeof numbers);
    } else {
        memcpy(at, &whole, sizeof whole);
    }
}

static void every_setting_is_a_field_of_the_request(void **state)
{
    static const unsigned others[] = {1, 7, 8, 9, 11, 12, 13, 14, 21, 22, 23, 24, 25, 26, 32};
    static const float point[3] = {1, 2, 3};
    const ProtobufCMessageDescriptor *message = &umbrage__v1__query_request__descriptor;
    struct umbw_query_request in = sample_request(point, NULL, 1), out;
    struct umbw_buffer buffer = {NULL, 0, 0};
    (void)state;
    for (size_t i = 0; i < umb__setting_count; i++) {
        give(&umb__settings[i], &in.settings);
    }
    in.settings.filter = UMB_FILTER_FOOTPRINT;
    assert_int_equal(umbw_encode_query_request(&in, &buffer, NULL), UMB_OK);
    const size_t size = buffer.size - UMBW_PREFIX_BYTES;
    const uint8_t *bytes = buffer.bytes + UMBW_PREFIX_BYTES;
    Umbrage__V1__QueryRequest *other = umbrage__v1__query_request__unpack(NULL, size, bytes);
    assert_non_null(other);
    for (size_t i = 0; i < umb__setting_count; i++) {
        const struct umb__setting *setting = &umb__settings[i];
        const ProtobufCFieldDescriptor *field =
            protobuf_c_message_descriptor_get_field_by_name(message, setting->name);
        if (field == NULL) {
            fail_msg("%s is no field of QueryRequest", setting->name);
        }
        const uint8_t *at = (uint8_t *)other + field->offset;
        if (setting->kind == UMB__SETTING_NUMBERS) {
            at = *(uint8_t *const *)at;
        }
        const size_t bytes_of = setting->kind == UMB__SETTING_NUMBERS  ? 3 * sizeof(double)
                                : setting->kind == UMB__SETTING_NUMBER ? sizeof(double)
                                                                       : sizeof(uint32_t);
        if (memcmp(at, (uint8_t *)&in.settings + setting->at, bytes_of) != 0 &&
            strcmp(setting->name, "format") != 0) { /* has numbers of its own */
            fail_msg("%s: its field has another value", setting->name);
        }
    }
    umbrage__v1__query_request__free_unpacked(other, NULL);
    assert_int_equal(umbw_decode_query_request(bytes, size, 1, &out, NULL), UMB_OK);
    assert_memory_equal(&out.settings, &in.settings, sizeof in.settings);
    umbw_buffer_finish(&buffer);
    /* Every other field must have a row in query_codec.c. */
    assert_int_equal(message->n_fields, umb__setting_count + sizeof others / sizeof others[0]);
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        assert_non_null(protobuf_c_message_descriptor_get_field(message, others[i]));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_setting_is_a_field_of_the_request),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
