// The WebAssembly module: whether the browser can run it, and how it is loaded.
import createModule from './cale_module.js';

/** The smallest module with a vector instruction. */
const simdModule = new Uint8Array([
    0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11,
]);
/** The smallest one with a `try`. */
const exceptionsModule = new Uint8Array([
    0, 97, 115, 109, 1, 0, 0, 0, 1, 4, 1, 96, 0, 0, 3, 2, 1, 0, 10, 8, 1, 6, 0, 6, 64, 25, 11, 11,
]);

// The oldest that have both, and 'wasm-unsafe-eval' in a content security policy.
const browsers = 'use Chrome or Edge from version 97 on, Firefox from 100, Safari from 16.4.';

/** Returns what this browser lacks, as a sentence; nothing if it lacks nothing. */
export function missingFeature() {
    if (typeof WebAssembly !== 'object') return 'This browser has no WebAssembly, in which the game runs.';
    if (!WebAssembly.validate(simdModule)) {
        return 'This browser’s WebAssembly has no SIMD, which the emulator and the policy need: ' + browsers;
    }
    if (!WebAssembly.validate(exceptionsModule)) {
        return 'This browser’s WebAssembly has no exceptions, which the emulator and the policy need: ' + browsers;
    }
    return '';
}

/** Returns a session (web/session.h) of a module of its own. */
export async function openSession() {
    const module = await createModule();
    return new module.Session();
}

/** Returns a file of this folder. Throws an Error whose message is a sentence, without its full stop. */
export async function fetchBytes(name) {
    const response = await fetch(name).catch((error) => {
        throw new Error(`${name} could not be read: ${error.message}`);
    });
    if (!response.ok) throw new Error(`${name} could not be read: the server answers ${response.status}`);
    return new Uint8Array(await response.arrayBuffer());
}
