// MuJoCo's WebAssembly build: unpacked, compiled once, started as often as a part of the page needs one.

/** What this page needs of a browser, and who has it. */
const REQUIREMENT = "It needs Chrome or Edge 103, Firefox 113 or Safari 16.4, or a newer one.";

/** An error whose message is for the reader of the page. */
export class LabError extends Error {}

export class Engine {
  /**
   * @param {string} script the source of mujoco.js
   * @param {WebAssembly.Module} compiled
   */
  constructor(script, compiled) {
    this.script = script;
    this.compiled = compiled;
    this.url = URL.createObjectURL(new Blob([script], { type: "text/javascript" }));
  }

  /**
   * Unpack and compile the engine.
   * @param {string} script mujoco.js, gzip in base64
   * @param {string} wasm mujoco.wasm, gzip in base64
   * @throws {LabError} this browser cannot
   */
  static async load(script, wasm) {
    if (typeof WebAssembly === "undefined")
      throw new LabError(`This browser has no WebAssembly. ${REQUIREMENT}`);
    if (typeof DecompressionStream === "undefined")
      throw new LabError(`This browser is too old. ${REQUIREMENT}`);
    const [text, bytes] = await Promise.all([unpack(script).text(), unpack(wasm).arrayBuffer()]);
    try {
      return new Engine(text, await WebAssembly.compile(bytes));
    } catch (error) {
      throw new LabError(`This browser cannot compile MuJoCo: ${messageOf(error)}. ${REQUIREMENT}`);
    }
  }

  /**
   * Start an engine with a memory of its own: what one allocates does not end the views of another.
   * @returns {Promise<import("@mujoco/mujoco").MainModule>}
   * @throws {LabError} there is too little memory
   */
  async start() {
    const { default: load } = await import(this.url);
    return instantiate(load, this.compiled);
  }

  /**
   * Return the source of mujoco.js as a script of a worker, which sets `loadMujoco`. A worker cannot import the
   * module: Chrome and WebKit refuse that on a page that is a file.
   * @returns {string}
   */
  get workerScript() {
    return this.script
      .replaceAll("import.meta.url", "location.href")
      .replace(/^export default loadMujoco;$/m, "");
  }
}

/**
 * Start a compiled engine.
 * @param {(options: object) => Promise<import("@mujoco/mujoco").MainModule>} load what mujoco.js exports
 * @param {WebAssembly.Module} compiled
 * @returns {Promise<import("@mujoco/mujoco").MainModule>}
 * @throws {LabError} there is too little memory
 */
export function instantiate(load, compiled) {
  return new Promise((resolve, reject) => {
    const fail = (/** @type {unknown} */ error) =>
      reject(new LabError(`MuJoCo cannot start: ${messageOf(error)}`));
    load({
      instantiateWasm: (
        /** @type {WebAssembly.Imports} */ imports,
        /** @type {Function} */ done,
      ) => {
        WebAssembly.instantiate(compiled, imports).then((instance) => done(instance), fail);
        return {};
      },
      print: () => {},
      printErr: () => {}, // what MuJoCo cannot do comes as an exception, too
    }).then(resolve, fail);
  });
}

/**
 * Return what an exception says, on one line; MuJoCo's without its prefix.
 * @param {unknown} error
 * @returns {string}
 */
export function messageOf(error) {
  const text = error instanceof Error ? error.message : String(error);
  return text
    .replace(/^(MuJoCo )?Error: /, "")
    .replaceAll(/\s+/g, " ")
    .trim();
}

/**
 * Return gzip in base64 as a response, which has its text or its bytes.
 * @param {string} base64
 * @returns {Response}
 */
function unpack(base64) {
  const bytes = Uint8Array.from(atob(base64.trim()), (character) => character.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")));
}
