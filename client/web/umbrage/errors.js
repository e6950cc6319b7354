// SPDX-License-Identifier: Apache-2.0
/** A failure. `code` is a name of umbrage/status.h, `message` one sentence: field, value, limit. */
export class UmbrageError extends Error {
  constructor(code, message, options) {
    super(message, options);
    this.name = "UmbrageError";
    this.code = code;
  }
}

/** Throws a UmbrageError if an argument is wrong. */
export function require(holds, message) {
  if (!holds) {
    throw new UmbrageError("E_ARGUMENT", message);
  }
}
