// A board without pins: real MicroPython with its prompt and its files, on stdin and stdout.
//
//     node board.mjs MODULES FAKES FLASH RECORDS EVENTS
//
// MODULES is the node_modules folder with MicroPython, FAKES the Python modules that replace the
// hardware, FLASH the folder that is the board's file system. As on a Pico, main.py runs after every
// reset, then the prompt. The fakes write a line per record to the descriptor RECORDS and read events
// from EVENTS.

import fs from "node:fs";
import path from "node:path";

const [modules, fakes, flash, records, happenings] = process.argv.slice(2);
const micropython = "@micropython/micropython-webassembly-pyscript/micropython.mjs";
const { loadMicroPython } = await import(path.resolve(modules, micropython));

const CTRL_A = 1, CTRL_B = 2, CTRL_D = 4, CTRL_E = 5;
const HEAP_BYTES = 192 * 1024; // as on a Pico; MicroPython takes more when it is full
const OUTLET_BYTES = 256; // what a Pico's USB stack holds
const TICKS_PERIOD_US = 2 ** 30;
const BEFORE_WRAP_US = 1_000_000; // the counter starts this long before it wraps; on a Pico it starts at 0
const HOST_STALLS_MS = 1500; // the longest that a write on a Pico waits for a host that does not read

class Inlet {
    // Bytes from a descriptor that may be non-blocking.
    constructor(descriptor) {
        this.descriptor = descriptor;
        this.waiting = Buffer.alloc(0);
        this.ended = false;
    }

    ready() {
        if (this.waiting.length === 0 && !this.ended) {
            flush();
            const chunk = Buffer.alloc(4096);
            try {
                const length = fs.readSync(this.descriptor, chunk);
                this.waiting = chunk.subarray(0, length);
                this.ended = length === 0;
            } catch (error) {
                if (error.code !== "EAGAIN" && error.code !== "EIO") throw error;
            }
        }
        return this.waiting.length > 0;
    }

    take() {
        // as Emscripten expects of a device: null is the end, undefined means no byte yet
        if (!this.ready()) return this.ended ? null : undefined;
        const byte = this.waiting[0];
        this.waiting = this.waiting.subarray(1);
        return byte;
    }
}

const line = new Inlet(0);
const events = new Inlet(Number(happenings));
let outlet = [];
let stalled = false;
let resetting = false;

function pause(ms) {
    Atomics.wait(new Int32Array(new SharedArrayBuffer(4)), 0, 0, ms);
}

function send(bytes) {
    // called for each byte; bytes are written together, at the latest when the board polls its input
    outlet.push(...bytes);
    const givesUp = Date.now() + HOST_STALLS_MS;
    while (outlet.length >= OUTLET_BYTES && !flush() && !stalled) {
        stalled = Date.now() > givesUp; // bytes that are not written are kept, as in the board file
        if (!stalled) pause(1);
    }
}

function flush() {
    // returns whether there is room again
    if (outlet.length > 0) {
        try {
            outlet = outlet.slice(fs.writeSync(1, Uint8Array.from(outlet)));
        } catch (error) {
            if (error.code !== "EAGAIN") throw error;
        }
    }
    if (outlet.length < OUTLET_BYTES) stalled = false;
    return outlet.length < OUTLET_BYTES;
}

function takeEvent() {
    if (!events.ready()) return "";
    let text = "";
    for (let byte = events.take(); byte !== 10; byte = events.take()) {
        text += String.fromCharCode(byte);
    }
    return text;
}

const host = {
    readable: () => line.ready(),
    writable: flush,
    record: (text) => fs.writeSync(Number(records), text + "\n"),
    event: takeEvent,
    reset: () => {
        flush();
        resetting = true;
    },
    ticks_us: () => (TICKS_PERIOD_US - BEFORE_WRAP_US + Math.floor(performance.now() * 1000))
        % TICKS_PERIOD_US,
};

function copyIn(mp, folder, target) {
    for (const name of fs.readdirSync(folder)) {
        if (fs.statSync(path.join(folder, name)).isFile()) {
            mp.FS.writeFile(target + name, fs.readFileSync(path.join(folder, name)));
        }
    }
}

function copyOut(mp) {
    const names = mp.FS.readdir("/").filter((name) => mp.FS.isFile(mp.FS.stat("/" + name).mode));
    for (const name of names) fs.writeFileSync(path.join(flash, name), mp.FS.readFile("/" + name));
    for (const name of fs.readdirSync(flash)) {
        if (!names.includes(name)) fs.unlinkSync(path.join(flash, name));
    }
}

async function boot(raw) {
    resetting = false;
    const mp = await loadMicroPython({
        heapsize: HEAP_BYTES, linebuffer: false, stdout: send, stdin: () => line.take(),
    });
    mp.FS.mkdir("/fakes");
    copyIn(mp, fakes, "/fakes/");
    copyIn(mp, flash, "/");
    mp.registerJsModule("host", host);
    mp.runPython("import sys; sys.path.insert(0, '/fakes')");
    if (!raw && fs.existsSync(path.join(flash, "main.py"))) {
        try {
            mp.runPython(fs.readFileSync(path.join(flash, "main.py"), "utf8"));
        } catch (error) {
            if (!resetting) send(Buffer.from(error.message.replaceAll("\n", "\r\n")));
        }
        copyOut(mp);
        if (resetting) return false;
    }
    mp.replInit();
    if (raw) mp.replProcessChar(CTRL_A);
    while (!line.ended) {
        if (!line.ready()) {
            pause(1);
            continue;
        }
        const byte = line.take();
        // this port cannot wait for bytes inside MicroPython, as raw paste mode does: R and 0 say so
        if (raw && byte === CTRL_E && line.ready()) {
            line.take();
            line.take();
            send(Buffer.from([0x52, 0]));
            continue;
        }
        if (byte === CTRL_A || byte === CTRL_B) raw = byte === CTRL_A;
        const left = mp.replProcessChar(byte);
        if (byte === CTRL_D) {
            flush();
            copyOut(mp);
        }
        if (resetting) return false;
        if (left) {
            send(Buffer.from("MPY: soft reboot\r\n"));
            return raw;
        }
    }
    while (outlet.length > 0) flush();
    process.exit();
}

let raw = false;
for (;;) raw = await boot(raw);
