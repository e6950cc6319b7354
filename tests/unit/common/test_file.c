/* SPDX-License-Identifier: Apache-2.0 */
/* Atomic replacement of files, and SHA-256 against its published vectors. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "common/file.h"
#include "common/sha256.h"
#include "folder_fixture.h"

static size_t count_files(const char *path)
{
    size_t count = 0;
    DIR *folder = opendir(path);
    struct dirent *item;
    while (folder != NULL && (item = readdir(folder)) != NULL) {
        count += strcmp(item->d_name, ".") != 0 && strcmp(item->d_name, "..") != 0;
    }
    closedir(folder);
    return count;
}

static void assert_content(const char *path, const char *expected)
{
    char text[64] = {0};
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    size_t count = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    assert_int_equal(count, strlen(expected));
    assert_string_equal(text, expected);
}

static void write_text(const char *path, const char *text)
{
    struct umbs_file file;
    assert_int_equal(umbs_file_begin(path, &file, NULL), UMB_OK);
    assert_int_equal(umbs_file_write(&file, text, strlen(text), NULL), UMB_OK);
    assert_int_equal(umbs_file_commit(&file, NULL), UMB_OK);
    umbs_file_abandon(&file); /* harmless after commit */
}

static void file_commit_replaces_whole_content(void **state)
{
    struct folder folder;
    (void)state;
    folder_make(&folder);
    write_text(folder_file(&folder, "a"), "first, and longer");
    write_text(folder_file(&folder, "a"), "second");
    assert_content(folder_file(&folder, "a"), "second");
    assert_int_equal(count_files(folder.path), 1);
    folder_remove(&folder);
}

static void file_before_commit_shows_the_old_content(void **state)
{
    struct folder folder;
    struct umbs_file file;
    (void)state;
    folder_make(&folder);
    write_text(folder_file(&folder, "a"), "old");
    assert_int_equal(umbs_file_begin(folder_file(&folder, "a"), &file, NULL), UMB_OK);
    assert_int_equal(umbs_file_write(&file, "new", 3, NULL), UMB_OK);
    assert_content(folder_file(&folder, "a"), "old");
    assert_int_equal(count_files(folder.path), 2);
    umbs_file_abandon(&file);
    assert_content(folder_file(&folder, "a"), "old");
    assert_int_equal(count_files(folder.path), 1);
    folder_remove(&folder);
}

static void file_begin_refuses_what_is_no_regular_file(void **state)
{
    struct folder folder;
    struct umbs_file file;
    struct umb_error error;
    (void)state;
    folder_make(&folder);
    assert_int_equal(umbs_file_begin(folder.path, &file, &error), UMB_E_CANNOT_CREATE);
    assert_int_equal(umbs_file_begin("/dev/null", &file, &error), UMB_E_CANNOT_CREATE);
    assert_non_null(strstr(error.message, "/dev/null"));
    assert_int_equal(umbs_file_begin(folder_file(&folder, "no/such"), &file, &error),
                     UMB_E_CANNOT_CREATE);
    assert_int_equal(umbs_file_begin(folder_file(&folder, ""), &file, &error), UMB_E_CANNOT_CREATE);
    umbs_file_abandon(&file);
    folder_remove(&folder);
}

static void file_commit_refuses_after_a_failed_write(void **state)
{
    struct folder folder;
    struct umbs_file file;
    struct umb_error error;
    (void)state;
    folder_make(&folder);
    write_text(folder_file(&folder, "a"), "old");
    assert_int_equal(umbs_file_begin(folder_file(&folder, "a"), &file, NULL), UMB_OK);
    /* A read-only descriptor stands for a full disk. */
    int read_only = open("/dev/null", O_RDONLY);
    assert_true(dup2(read_only, file.fd) >= 0);
    close(read_only);
    assert_int_equal(umbs_file_write(&file, "new", 3, &error), UMB_E_IO);
    assert_int_equal(umbs_file_write(&file, "", 0, &error), UMB_E_IO);
    assert_int_equal(umbs_file_commit(&file, &error), UMB_E_IO);
    assert_content(folder_file(&folder, "a"), "old");
    assert_int_equal(count_files(folder.path), 1);
    folder_remove(&folder);
}

static void file_abandon_accepts_a_zeroed_struct(void **state)
{
    struct umbs_file file = {0};
    (void)state;
    umbs_file_abandon(&file);
    assert_int_equal(umbs_file_commit(&file, NULL), UMB_E_STATE);
}

static void sha256_equals_the_published_vectors(void **state)
{
    /* FIPS 180-2, appendix B.1 and B.2, and the empty string. */
    static const char *const texts[3] = {
        "abc", "abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq", ""};
    static const char *const digests[3] = {
        "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
        "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1",
        "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855",
    };
    (void)state;
    for (size_t i = 0; i < 3; i++) {
        uint8_t digest[UMB_ID_BYTES];
        char text[UMB_ID_TEXT_SIZE];
        size_t size = strlen(texts[i]);
        umbs_sha256_bytes(texts[i], size, digest);
        umb_id_to_text(digest, text);
        assert_string_equal(text, digests[i]);
        /* The same in two parts. */
        const void *parts[2] = {texts[i], texts[i] + size / 2};
        size_t sizes[2] = {size / 2, size - size / 2};
        umbs_sha256.digest(umbs_sha256.user, parts, sizes, 2, digest);
        umb_id_to_text(digest, text);
        assert_string_equal(text, digests[i]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(file_commit_replaces_whole_content),
        cmocka_unit_test(file_before_commit_shows_the_old_content),
        cmocka_unit_test(file_begin_refuses_what_is_no_regular_file),
        cmocka_unit_test(file_commit_refuses_after_a_failed_write),
        cmocka_unit_test(file_abandon_accepts_a_zeroed_struct),
        cmocka_unit_test(sha256_equals_the_published_vectors),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
