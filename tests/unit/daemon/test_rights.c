/* SPDX-License-Identifier: Apache-2.0 */
/* Rates, the table of addresses, and the file of tokens. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/sha256.h"
#include "daemon/base/rate_limit.h"
#include "daemon/base/tokens.h"

#define SECOND 1000000000ULL

static void rate_holds_on_average_whatever_the_batches(void **state)
{
    (void)state;
    const uint64_t sizes[] = {1, 64, 1000, 5000, 40000};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        atomic_uint_fast64_t until = 0;
        uint64_t now = 5 * SECOND;
        uint64_t wait = 0;
        uint64_t taken = 0;
        for (uint64_t end = now + 100 * SECOND; now<end; now += wait> 0 ? wait : 1000) {
            if (umbd_rate_take(&until, 1000, sizes[i], now, &wait)) {
                taken += sizes[i];
            } else {
                assert_true(wait > 0);
            }
        }
        assert_true(taken >= 100 * 1000);                /* it may be used to the full */
        assert_true(taken <= 102 * 1000 + 2 * sizes[i]); /* and a second and a batch ahead */
    }
}

static void rate_says_the_time_after_which_it_takes_again(void **state)
{
    (void)state;
    atomic_uint_fast64_t until = 0;
    uint64_t now = SECOND;
    uint64_t wait = 0;
    assert_true(umbd_rate_take(&until, 10, 100, now, &wait));
    assert_false(umbd_rate_take(&until, 10, 1, now, &wait));
    assert_int_equal(wait, 9 * SECOND);
    assert_false(umbd_rate_take(&until, 10, 1, now + wait - 1, &wait));
    assert_true(umbd_rate_take(&until, 10, 1, now + 9 * SECOND, &wait));
    assert_true(umbd_rate_take(&until, 0, UINT64_MAX, now, &wait)); /* no limit */
    for (unsigned i = 0; i < 64; i++) { /* debts of 64 submissions side by side */
        umbd_rate_owe(&until, 1000, 5000000, now);
    }
    assert_true(umbd_rate_take(&until, 10, 1, now + 3601 * SECOND, &wait));
}

static void rate_gives_back_exactly_what_it_took(void **state)
{
    (void)state;
    atomic_uint_fast64_t until = 0;
    uint64_t wait = 0;
    assert_true(umbd_rate_take(&until, 1000, 700, 5 * SECOND, &wait));
    uint64_t before = atomic_load(&until);
    assert_true(umbd_rate_take(&until, 1000, 333, 5 * SECOND, &wait));
    umbd_rate_return(&until, 1000, 333);
    assert_int_equal(atomic_load(&until), before);
    umbd_rate_return(&until, 0, 1); /* without a limit nothing was taken */
    assert_int_equal(atomic_load(&until), before);
}

static struct sockaddr_storage v4(uint32_t host)
{
    struct sockaddr_storage storage;
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(host)};
    memset(&storage, 0, sizeof storage);
    memcpy(&storage, &address, sizeof address);
    return storage;
}

static struct sockaddr_storage v6(uint8_t customer, uint8_t host)
{
    struct sockaddr_storage storage;
    struct sockaddr_in6 address = {.sin6_family = AF_INET6};
    memset(&storage, 0, sizeof storage);
    address.sin6_addr.s6_addr[7] = customer;
    address.sin6_addr.s6_addr[15] = host;
    memcpy(&storage, &address, sizeof address);
    return storage;
}

static void peers_are_counted_by_address_and_v6_by_its_half(void **state)
{
    (void)state;
    struct umbd_peer_table *table = umbd_peers_create();
    struct umbd_peer_account *one, *two, *three, *four, *none;
    const char *reason;
    size_t strangers = 9;
    struct sockaddr_storage a = v4(1), b = v4(2), c = v6(1, 1), d = v6(1, 2), e = v6(2, 1);
    assert_non_null(table);
    assert_true(umbd_peers_acquire(table, &a, 1, &one, &strangers, &reason));
    assert_false(umbd_peers_acquire(table, &a, 1, &none, &strangers, &reason));
    assert_non_null(strstr(reason, "one address"));
    assert_int_equal(strangers, 0);
    atomic_store(&one->strangers, 1);
    assert_false(umbd_peers_acquire(table, &a, 1, &none, &strangers, &reason));
    assert_int_equal(strangers, 1);
    atomic_store(&one->strangers, 0);
    assert_true(umbd_peers_acquire(table, &b, 1, &two, &strangers, &reason));
    assert_true(umbd_peers_acquire(table, &c, 1, &three, &strangers, &reason));
    assert_false(umbd_peers_acquire(table, &d, 1, &none, &strangers, &reason));
    assert_true(umbd_peers_acquire(table, &e, 1, &four, &strangers, &reason));
    umbd_peers_release(table, one, 0);
    assert_true(umbd_peers_acquire(table, &a, 1, &one, &strangers, &reason));
    umbd_peers_release(table, one, 0);
    umbd_peers_release(table, two, 0);
    umbd_peers_release(table, three, 0);
    umbd_peers_release(table, four, 0);
    umbd_peers_release(table, NULL, 0);
    umbd_peers_destroy(table);
}

/* An IPv6 address by its text. */
static struct sockaddr_storage v6_text(const char *text)
{
    struct sockaddr_storage storage;
    struct sockaddr_in6 address = {.sin6_family = AF_INET6};
    memset(&storage, 0, sizeof storage);
    assert_int_equal(inet_pton(AF_INET6, text, &address.sin6_addr), 1);
    memcpy(&storage, &address, sizeof address);
    return storage;
}

static int same_customer(struct sockaddr_storage a, struct sockaddr_storage b)
{
    uint8_t keys[2][UMBD_PEER_KEY_BYTES];
    umbd_peer_key(&a, keys[0]);
    umbd_peer_key(&b, keys[1]);
    return memcmp(keys[0], keys[1], UMBD_PEER_KEY_BYTES) == 0;
}

static void customers_are_told_apart_by_what_each_has(void **state)
{
    (void)state;
    uint8_t local[UMBD_PEER_KEY_BYTES];
    uint8_t zeros[UMBD_PEER_KEY_BYTES] = {0};
    umbd_peer_key(NULL, local);
    assert_memory_equal(local, zeros, sizeof local);
    assert_true(same_customer(v6_text("::ffff:10.0.0.1"), v4(0x0a000001))); /* dual stack */
    assert_false(same_customer(v6_text("::ffff:10.0.0.1"), v6_text("::ffff:10.0.0.2")));
    assert_true(same_customer(v6_text("64:ff9b::10.0.0.1"), v4(0x0a000001))); /* NAT64 */
    assert_false(same_customer(v6_text("64:ff9b::10.0.0.1"), v6_text("64:ff9b::10.0.0.2")));
    assert_true(same_customer(v6_text("2001:db8::1"), v6_text("2001:db8::ffff:10.0.0.1")));
    assert_false(same_customer(v6_text("2001:db8:0:1::1"), v6_text("2001:db8:0:2::1")));
    assert_false(same_customer(v6_text("fe80::1"), v6_text("fe80::2"))); /* one link, many hosts */
    assert_false(same_customer(v6_text("::1"), v4(1)));
}

static void a_peer_cannot_know_the_addresses_of_one_chain(void **state)
{
    (void)state;
    struct umbd_peer_table *one = umbd_peers_create(), *two = umbd_peers_create();
    size_t elsewhere = 0, spread = 0, first = 0;
    assert_true(one != NULL && two != NULL);
    for (uint32_t host = 0; host < 64; host++) { /* by chance each is alike once in 1024 */
        struct sockaddr_storage address = v4(host);
        uint8_t key[UMBD_PEER_KEY_BYTES];
        umbd_peer_key(&address, key);
        const size_t chain = umbd_peers_chain(one, key);
        first = host == 0 ? chain : first;
        spread += chain != first;
        elsewhere += chain != umbd_peers_chain(two, key);
        assert_int_equal(chain, umbd_peers_chain(one, key));
    }
    assert_true(elsewhere > 32 && spread > 32);
    umbd_peers_destroy(one);
    umbd_peers_destroy(two);
}

static void each_clock_of_an_account_outlives_its_connections(void **state)
{
    (void)state;
    for (int which = 0; which < 3; which++) {
        struct umbd_peer_table *table = umbd_peers_create();
        struct umbd_peer_account *account;
        const char *reason;
        size_t strangers;
        uint64_t wait;
        struct sockaddr_storage address = v4(8), other = v4(9);
        assert_non_null(table);
        for (int round = 0; round < 2; round++) {
            assert_true(umbd_peers_acquire(table, &address, 9, &account, &strangers, &reason));
            atomic_uint_fast64_t *clock = which == 0   ? &account->paid_until_ns
                                          : which == 1 ? &account->open_until_ns
                                                       : &account->handshake_until_ns;
            assert_int_equal(umbd_rate_take(clock, 1, 5, SECOND, &wait), round == 0);
            umbd_peers_release(table, account, SECOND);
            assert_true(umbd_peers_acquire(table, &other, 9, &account, &strangers, &reason));
            umbd_peers_release(table, account, SECOND); /* may sweep the chain */
        }
        umbd_peers_destroy(table);
    }
}

static void debts_outlive_the_connections(void **state)
{
    (void)state;
    struct umbd_peer_table *table = umbd_peers_create();
    struct umbd_peer_account *account;
    const char *reason;
    size_t strangers;
    uint64_t wait;
    struct sockaddr_storage address = v4(7);
    assert_non_null(table);
    assert_true(umbd_peers_acquire(table, &address, 9, &account, &strangers, &reason));
    assert_true(umbd_rate_take(&account->paid_until_ns, 10, 100, SECOND, &wait));
    umbd_peers_release(table, account, SECOND);
    assert_true(umbd_peers_acquire(table, &address, 9, &account, &strangers, &reason));
    assert_false(umbd_rate_take(&account->paid_until_ns, 10, 1, SECOND, &wait));
    umbd_peers_release(table, account, 100 * SECOND);
    umbd_peers_destroy(table);
}

static char path[] = "/tmp/umbrage-tokens-XXXXXX";

static int make_file(void **state)
{
    (void)state;
    memcpy(path + sizeof path - 7, "XXXXXX", 6);
    int fd = mkstemp(path);
    return fd >= 0 ? close(fd) : -1;
}

static int remove_file(void **state)
{
    (void)state;
    return unlink(path);
}

static void write_file(const char *text)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_true(fputs(text, file) >= 0);
    assert_int_equal(fclose(file), 0);
}

static struct umbd_token *find(struct umbd_token_set *set, const char *token)
{
    uint8_t hash[UMBD_HASH_BYTES];
    umbs_sha256_bytes(token, strlen(token), hash);
    return umbd_token_find(set, hash);
}

static void tokens_are_found_by_their_hash_and_reloaded(void **state)
{
    (void)state;
    struct umbd_tokens *tokens;
    struct umb_error error;
    write_file("# who may do what\n\n"
               "studio query,submit 0123456789abcdef 5000  # a comment\n"
               "  root\tadmin,query   fedcba9876543210");
    assert_int_equal(umbd_tokens_create(path, &tokens, &error), UMB_OK);
    struct umbd_token_set *set = umbd_tokens_acquire(tokens);
    struct umbd_token *studio = find(set, "0123456789abcdef");
    assert_non_null(studio);
    assert_string_equal(studio->name, "studio");
    assert_int_equal(studio->scopes, UMBD_SCOPE_QUERY | UMBD_SCOPE_SUBMIT);
    assert_int_equal(studio->points_per_second, 5000);
    assert_int_equal(find(set, "fedcba9876543210")->scopes, UMBD_SCOPE_ADMIN | UMBD_SCOPE_QUERY);
    assert_null(find(set, "0123456789abcdeg"));
    assert_null(find(set, ""));
    unsigned before = umbd_tokens_generation(tokens);
    write_file("studio query aaaaaaaaaaaaaaaa\n");
    assert_int_equal(umbd_tokens_reload(tokens, &error), UMB_OK);
    assert_int_not_equal(umbd_tokens_generation(tokens), before);
    assert_string_equal(studio->name, "studio"); /* held, so still there */
    umbd_token_set_release(set);
    write_file("studio query short\n");
    assert_int_equal(umbd_tokens_reload(tokens, &error), UMB_E_ARGUMENT);
    set = umbd_tokens_acquire(tokens);
    assert_non_null(find(set, "aaaaaaaaaaaaaaaa"));
    umbd_token_set_release(set);
    umbd_tokens_destroy(tokens);
}

static void tokens_name_the_line_that_is_wrong(void **state)
{
    (void)state;
    static const char *const lines[] = {
        "studio query\n",
        "studio query 0123456789abcdef 5000 more\n",
        "studio queries 0123456789abcdef\n",
        "studio query, 0123456789abcdef\n",
        "studio query 0123456789abcde\n",
        "studio query 0123456789abcdef -5\n",
        "studio query 0123456789abcdef 5x\n",
        "studio query 0123456789abcdef 99999999999999999999999\n",
        "studio query 0123456789abcdef#ghi\n", /* cut there it would still be long enough */
        "studio query 0123456789abcdef 5000#ghi\n",
        "studio#1 query 0123456789abcdef\n",
    };
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        struct umbd_tokens *tokens;
        struct umb_error error;
        char text[200];
        snprintf(text, sizeof text, "# first\n%s", lines[i]);
        write_file(text);
        assert_int_equal(umbd_tokens_create(path, &tokens, &error), UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, "line 2"));
        assert_null(tokens);
    }
}

static void tokens_that_others_may_read_are_refused(void **state)
{
    (void)state;
    struct umbd_tokens *tokens;
    struct umb_error error;
    write_file("studio query 0123456789abcdef\n");
    assert_int_equal(chmod(path, 0644), 0);
    assert_int_equal(umbd_tokens_create(path, &tokens, &error), UMB_E_PERMISSION);
    assert_int_equal(umbd_tokens_create("/nowhere/tokens", &tokens, &error), UMB_E_NO_INPUT);
}

static void tokens_of_a_fifo_are_refused_and_nobody_waits(void **state)
{
    (void)state;
    struct umbd_tokens *tokens;
    struct umb_error error;
    assert_int_equal(unlink(path), 0);
    assert_int_equal(mkfifo(path, 0600), 0);
    assert_int_equal(umbd_tokens_create(path, &tokens, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "is not a file"));
}

int main(void)
{
#define WITH_FILE(test) cmocka_unit_test_setup_teardown(test, make_file, remove_file)
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rate_holds_on_average_whatever_the_batches),
        cmocka_unit_test(rate_says_the_time_after_which_it_takes_again),
        cmocka_unit_test(rate_gives_back_exactly_what_it_took),
        cmocka_unit_test(peers_are_counted_by_address_and_v6_by_its_half),
        cmocka_unit_test(customers_are_told_apart_by_what_each_has),
        cmocka_unit_test(a_peer_cannot_know_the_addresses_of_one_chain),
        cmocka_unit_test(each_clock_of_an_account_outlives_its_connections),
        cmocka_unit_test(debts_outlive_the_connections),
        WITH_FILE(tokens_are_found_by_their_hash_and_reloaded),
        WITH_FILE(tokens_name_the_line_that_is_wrong),
        WITH_FILE(tokens_that_others_may_read_are_refused),
        WITH_FILE(tokens_of_a_fifo_are_refused_and_nobody_waits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
