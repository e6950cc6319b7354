/* SPDX-License-Identifier: Apache-2.0 */
/*
 * TLS sessions of connections, with a client in memory. Records that are kept and sent later must
 * arrive in order and once. Bytes that do not fit, or are not TLS, must end the session. Files that
 * cannot be used must be refused by name, and a reload with one must change nothing.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "daemon/transport/conn_tls.h"
#include "daemon/transport/loop.h"

struct fixture {
    char folder[64], certificate[96], key[96], other_key[96];
    struct umbd_tls_files files;
    struct umbd_server server;
    struct umbd_loop loop;
    struct umbd_conn conn;
    SSL_CTX *context;
    SSL *client;
    uint8_t got[1 << 20]; /* plain bytes that the daemon read */
    size_t got_size;
    int stop_with;
};

static void write_key(const char *path, EVP_PKEY *key)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_int_equal(PEM_write_PrivateKey(file, key, NULL, NULL, 0, NULL, NULL), 1);
    assert_int_equal(fclose(file), 0);
}

/* A certificate that signs itself, its key, and the key of another one. */
static void write_files(struct fixture *f)
{
    EVP_PKEY *key = EVP_EC_gen("P-256"), *other = EVP_EC_gen("P-256");
    X509 *made = X509_new();
    assert_true(key != NULL && other != NULL && made != NULL);
    X509_NAME *name = X509_get_subject_name(made);
    X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC, (const unsigned char *)"localhost", -1, -1,
                               0);
    ASN1_INTEGER_set(X509_get_serialNumber(made), 1);
    X509_gmtime_adj(X509_getm_notBefore(made), -60);
    X509_gmtime_adj(X509_getm_notAfter(made), 3600);
    X509_set_issuer_name(made, name);
    X509_set_pubkey(made, key);
    assert_true(X509_sign(made, key, EVP_sha256()) > 0);
    FILE *file = fopen(f->certificate, "w");
    assert_non_null(file);
    assert_int_equal(PEM_write_X509(file, made), 1);
    assert_int_equal(fclose(file), 0);
    write_key(f->key, key);
    write_key(f->other_key, other);
    X509_free(made);
    EVP_PKEY_free(key);
    EVP_PKEY_free(other);
}

static void make_client(struct fixture *f, const char *protocol)
{
    f->client = SSL_new(f->context);
    assert_non_null(f->client);
    SSL_set_bio(f->client, BIO_new(BIO_s_mem()), BIO_new(BIO_s_mem()));
    SSL_set_connect_state(f->client);
    if (protocol != NULL) {
        assert_int_equal(SSL_set_alpn_protos(f->client, (const unsigned char *)protocol,
                                             (unsigned)strlen(protocol)),
                         0);
    }
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    struct umb_error error;
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-tls-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->certificate, sizeof f->certificate, "%s/cert", f->folder);
    snprintf(f->key, sizeof f->key, "%s/key", f->folder);
    snprintf(f->other_key, sizeof f->other_key, "%s/other", f->folder);
    write_files(f);
    f->files = (struct umbd_tls_files){.certificate = f->certificate, .key = f->key};
    assert_int_equal(umbd_tls_create(&f->files, &f->server.tls, &error), UMB_OK);
    f->loop.server = f->conn.server = &f->server;
    f->loop.out = malloc(UMBD_OUT_CAPACITY);
    assert_non_null(f->loop.out);
    f->conn.loop = &f->loop;
    assert_int_equal(umbd_conn_tls_start(&f->conn), UMB_OK);
    f->context = SSL_CTX_new(TLS_client_method());
    assert_non_null(f->context);
    make_client(f, "\x02h2");
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    umbd_conn_tls_finish(&f->conn);
    umbd_conn_tls_finish(&f->conn); /* twice is once */
    umbd_tls_destroy(f->server.tls);
    SSL_free(f->client);
    SSL_CTX_free(f->context);
    unlink(f->certificate);
    unlink(f->key);
    unlink(f->other_key);
    rmdir(f->folder);
    free(f->loop.out);
    free(f->loop.sealed);
    free(f);
    return 0;
}

static int take_plain(void *user, const uint8_t *bytes, size_t count)
{
    struct fixture *f = user;
    assert_true(count <= sizeof f->got - f->got_size);
    memcpy(f->got + f->got_size, bytes, count);
    f->got_size += count;
    return f->stop_with;
}

/* Gives the daemon what the client has written so far; returns the result of umbn_tls_open. */
static int to_daemon(struct fixture *f)
{
    uint8_t records[65536];
    const int count = BIO_read(SSL_get_wbio(f->client), records, sizeof records);
    return umbn_tls_open(f->conn.tls->session, records, count > 0 ? (size_t)count : 0, take_plain,
                         f);
}

/* Encrypts `count` bytes of output and gives the client what is to be sent. */
static size_t to_client(struct fixture *f, size_t count)
{
    const uint8_t *bytes = NULL;
    size_t size = 0;
    assert_true(umbd_conn_tls_seal(&f->conn, count, &bytes, &size));
    assert_true(size == 0 || BIO_write(SSL_get_rbio(f->client), bytes, (int)size) == (int)size);
    return size;
}

static void shake_hands(struct fixture *f)
{
    for (int i = 0; i < 4 && !SSL_is_init_finished(f->client); i++) {
        (void)SSL_do_handshake(f->client);
        assert_int_equal(to_daemon(f), 0);
        (void)to_client(f, 0);
    }
    assert_true(SSL_is_init_finished(f->client));
    assert_true(umbn_tls_ready(f->conn.tls->session));
}

static void say(struct fixture *f, const char *text)
{
    assert_int_equal(SSL_write(f->client, text, (int)strlen(text)), (int)strlen(text));
}

static void bytes_go_both_ways_and_a_goodbye_is_one(void **state)
{
    struct fixture *f = *state;
    char back[64];
    assert_false(umbn_tls_ready(f->conn.tls->session));
    shake_hands(f);
    say(f, "hello");
    assert_int_equal(to_daemon(f), 0);
    assert_int_equal(f->got_size, 5);
    assert_memory_equal(f->got, "hello", 5);
    memcpy(f->loop.out, "answer", 6);
    assert_true(to_client(f, 6) > 6);
    assert_int_equal(SSL_read(f->client, back, sizeof back), 6);
    assert_memory_equal(back, "answer", 6);
    assert_int_equal(to_client(f, 0), 0); /* nothing twice */
    assert_int_equal(SSL_shutdown(f->client), 0);
    assert_int_equal(to_daemon(f), UMBN_TLS_OVER);
    umbn_tls_bye(f->conn.tls->session);
    assert_true(to_client(f, 0) > 0);
    assert_int_equal(SSL_read(f->client, back, sizeof back), 0);
    assert_int_equal(SSL_get_error(f->client, 0), SSL_ERROR_ZERO_RETURN);
}

static void what_the_reader_returns_stops_the_reading(void **state)
{
    struct fixture *f = *state;
    shake_hands(f);
    say(f, "one");
    say(f, "two");
    f->stop_with = 7;
    assert_int_equal(to_daemon(f), 7);
    assert_int_equal(f->got_size, 3);
}

static void records_that_had_to_wait_arrive_before_later_ones(void **state)
{
    struct fixture *f = *state;
    char back[64];
    assert_true(umbd_conn_tls_keep(&f->conn)); /* nothing to keep */
    (void)SSL_do_handshake(f->client);
    assert_int_equal(to_daemon(f), 0);
    assert_true(f->loop.sealed_size > 0); /* its part of the handshake */
    assert_true(umbd_conn_tls_keep(&f->conn));
    assert_int_equal(f->loop.sealed_size, 0);
    assert_true(to_client(f, 0) > 0);
    assert_int_equal(SSL_do_handshake(f->client), 1);
    assert_int_equal(to_daemon(f), 0);
    assert_true(f->loop.sealed_size > 0); /* tickets: sealed by the order in which they are sent */
    assert_true(umbd_conn_tls_keep(&f->conn));
    memcpy(f->loop.out, "later", 5);
    assert_true(to_client(f, 5) > 5);
    assert_int_equal(SSL_read(f->client, back, sizeof back), 5);
    assert_memory_equal(back, "later", 5);
    assert_int_equal(to_client(f, 0), 0); /* and once */
}

/* Stands for records that the library has written and that cannot be sent yet. */
static void put_records(struct fixture *f, size_t count)
{
    memset(f->loop.sealed, 0x17, count);
    f->loop.sealed_size = count;
}

static void more_than_a_peer_may_have_waiting_ends_it(void **state)
{
    struct fixture *f = *state;
    shake_hands(f);
    put_records(f, 40000);
    assert_true(umbd_conn_tls_keep(&f->conn));
    put_records(f, 25536);
    assert_true(umbd_conn_tls_keep(&f->conn)); /* 64 KiB to the byte */
    put_records(f, 1);
    assert_false(umbd_conn_tls_keep(&f->conn));
}

static void what_does_not_fit_is_not_sealed(void **state)
{
    struct fixture *f = *state;
    const uint8_t *bytes = NULL;
    size_t size = 0;
    shake_hands(f);
    put_records(f, 100);
    assert_true(umbd_conn_tls_keep(&f->conn));
    f->loop.sealed_size = UMBD_SEALED_CAPACITY - 99;
    assert_false(umbd_conn_tls_seal(&f->conn, 0, &bytes, &size));
    f->loop.sealed_size = 0;
    assert_true(umbd_conn_tls_seal(&f->conn, 0, &bytes, &size));
    assert_int_equal(size, 100);
    f->loop.sealed_size = UMBD_SEALED_CAPACITY - 1;
    assert_false(umbd_conn_tls_seal(&f->conn, 100, &bytes, &size));
}

static void noise_and_other_protocols_are_broken(void **state)
{
    struct fixture *f = *state;
    static const uint8_t noise[] = "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";
    assert_int_equal(umbn_tls_open(f->conn.tls->session, noise, sizeof noise - 1, take_plain, f),
                     UMBN_TLS_BROKEN);
    static const char *const protocols[] = {"\x08http/1.1", NULL};
    for (size_t i = 0; i < 2; i++) {
        int code = 0;
        umbd_conn_tls_finish(&f->conn);
        f->loop.sealed_size = 0;
        assert_int_equal(umbd_conn_tls_start(&f->conn), UMB_OK);
        SSL_free(f->client);
        make_client(f, protocols[i]);
        for (int turn = 0; turn < 4 && code == 0; turn++) {
            (void)SSL_do_handshake(f->client);
            code = to_daemon(f);
            (void)to_client(f, 0);
        }
        /* a client without ALPN gets through OpenSSL's handshake */
        assert_int_equal(code, protocols[i] != NULL ? UMBN_TLS_BROKEN : UMBN_TLS_NO_PROTOCOL);
        assert_false(umbn_tls_ready(f->conn.tls->session));
    }
    assert_int_equal(f->got_size, 0);
}

static void a_record_that_was_changed_ends_it(void **state)
{
    struct fixture *f = *state;
    uint8_t record[256];
    shake_hands(f);
    say(f, "hello");
    const int size = BIO_read(SSL_get_wbio(f->client), record, sizeof record);
    assert_true(size > 10);
    record[size - 1] ^= 1;
    assert_int_equal(umbn_tls_open(f->conn.tls->session, record, (size_t)size, take_plain, f),
                     UMBN_TLS_BROKEN);
    assert_int_equal(f->got_size, 0);
}

static void clients_without_certificates_stay_after_a_reload(void **state)
{
    struct fixture *f = *state;
    struct umb_error error;
    assert_true(umbd_conn_tls_is_admitted(&f->conn)); /* its handshake will judge it */
    shake_hands(f);
    assert_true(umbd_conn_tls_is_admitted(&f->conn));
    assert_int_equal(umbd_tls_reload(f->server.tls, &error), UMB_OK);
    f->loop.tls_looks = 1000; /* this tick has looked at its share: later */
    assert_true(umbd_conn_tls_is_admitted(&f->conn));
    f->loop.tls_looks = 0;
    assert_true(umbd_conn_tls_is_admitted(&f->conn));
    assert_int_equal(f->loop.tls_looks, 1);
    assert_true(umbd_conn_tls_is_admitted(&f->conn)); /* judged by these files already */
    assert_int_equal(f->loop.tls_looks, 1);
}

#define ABSENT(option, path) option ": '" path "' cannot be used: No such file or directory"

static void files_that_cannot_be_used_are_refused_by_name(void **state)
{
    struct fixture *f = *state;
    struct umb_error error;
    const struct {
        struct umbd_tls_files files;
        enum umb_status status;
        const char *word;
    } cases[] = {
        {{"/nowhere/cert", f->key, NULL, NULL},
         UMB_E_NO_INPUT,
         ABSENT("--tls-cert", "/nowhere/cert")},
        {{f->key, f->key, NULL, NULL}, UMB_E_ARGUMENT, "--tls-cert"},
        {{f->certificate, "/nowhere/key", NULL, NULL},
         UMB_E_NO_INPUT,
         ABSENT("--tls-key", "/nowhere/key")},
        {{f->certificate, f->other_key, NULL, NULL}, UMB_E_ARGUMENT, "--tls-key"},
        {{f->folder, f->key, NULL, NULL}, UMB_E_NO_INPUT, "regular file"},
        {{f->certificate, f->key, "/nowhere/ca", NULL},
         UMB_E_NO_INPUT,
         ABSENT("--tls-client-ca", "/nowhere/ca")},
        {{f->certificate, f->key, f->key, NULL}, UMB_E_ARGUMENT, "--tls-client-ca"},
        {{f->certificate, f->key, f->certificate, "/nowhere/crl"},
         UMB_E_NO_INPUT,
         ABSENT("--tls-crl", "/nowhere/crl")},
        {{f->certificate, f->key, f->certificate, f->key}, UMB_E_ARGUMENT, "--tls-crl"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umbd_tls *tls;
        assert_int_equal(umbd_tls_create(&cases[i].files, &tls, &error), cases[i].status);
        assert_null(tls);
        assert_non_null(strstr(error.message, cases[i].word));
    }
}

static void a_reload_that_fails_changes_nothing(void **state)
{
    struct fixture *f = *state;
    struct umb_error error;
    const unsigned before = umbd_tls_generation(f->server.tls);
    assert_int_equal(unlink(f->key), 0);
    assert_int_equal(umbd_tls_reload(f->server.tls, &error), UMB_E_NO_INPUT);
    assert_int_equal(umbd_tls_generation(f->server.tls), before);
    shake_hands(f); /* by the files of before */
}

int main(void)
{
#define WITH_CONN(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
    const struct CMUnitTest tests[] = {
        WITH_CONN(bytes_go_both_ways_and_a_goodbye_is_one),
        WITH_CONN(what_the_reader_returns_stops_the_reading),
        WITH_CONN(records_that_had_to_wait_arrive_before_later_ones),
        WITH_CONN(more_than_a_peer_may_have_waiting_ends_it),
        WITH_CONN(what_does_not_fit_is_not_sealed),
        WITH_CONN(noise_and_other_protocols_are_broken),
        WITH_CONN(a_record_that_was_changed_ends_it),
        WITH_CONN(clients_without_certificates_stay_after_a_reload),
        WITH_CONN(files_that_cannot_be_used_are_refused_by_name),
        WITH_CONN(a_reload_that_fails_changes_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
