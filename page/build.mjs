// Builds p3dof/page/page.html: one file with all scripts and styles in it. `--check` only compares.
import { createHash } from "node:crypto";
import { readFile, readdir, writeFile } from "node:fs/promises";
import { basename, dirname } from "node:path";
import process from "node:process";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const target = fileURLToPath(new URL("../p3dof/page/page.html", import.meta.url));
/** What Python fills in, in the order of the page. */
const PLACES = ["@@TITLE@@", "@@ENGINE@@", "@@DOCUMENT@@"];

/** @param {string} path relative to this file */
const read = async (path) => (await readFile(new URL(path, import.meta.url), "utf8")).trim();

const THREE = fileURLToPath(new URL("node_modules/three/src/", import.meta.url));
/** What of three.js no material of the page needs: shaders, and pieces of them for what is never switched on. */
const UNUSED = /ShaderLib.(backgroundCube|cube|distance|equirect|linedashed|meshmatcap|meshphysical|meshtoon|shadow|vsm)\.glsl\.js$/;
const NEVER = /^(shadowmap|tonemapping_pars|envmap|bumpmap|displacementmap|aomap|lightmap|lightprobes|morph|skin|batching|fog|alphahash|logdepthbuf)/;
/** What stands in the place of virtual reality, shadows and mirrored surroundings. @type {Record<string, string>} */
const LEFT_OUT = {
    WebXRManager: `import { EventDispatcher } from "../../core/EventDispatcher.js";
        export class WebXRManager extends EventDispatcher {
            enabled = false;
            isPresenting = false;
            setAnimationLoop() {}
            getEnvironmentBlendMode() {}
            dispose() {}
        }`,
    WebGLShadowMap: `export class WebGLShadowMap {
            enabled = false;
            render() {}
        }`,
    PMREMGenerator: `export class PMREMGenerator {
            dispose() {}
        }`,
};
const SHADER = /\/\* glsl \*\/\s*`(.*?)`/gs;

/** Text of a shader without comments and indentation. @param {string} text */
const short = (text) =>
    text.replace(/\r|\/\*.*?\*\//gs, "").replace(/[ \t]*\/\/.*$/gm, "").replace(/^[ \t]+|[ \t]+$/gm, "").replace(/\n{2,}/g, "\n");

/** Names of the pieces that the shaders of the page are put together from. */
async function piecesUsed() {
    const folder = `${THREE}renderers/shaders/`;
    /** @type {Set<string>} */
    const found = new Set();
    /** @param {string} text */
    const follow = async (text) => {
        for (const [, name] of text.matchAll(/(?:#include <|ShaderChunk\[ ')(\w+)/g)) {
            if (found.has(name)) continue;
            found.add(name);
            await follow(await readFile(`${folder}ShaderChunk/${name}.glsl.js`, "utf8"));
        }
    };
    await follow(await readFile(`${THREE}renderers/webgl/WebGLProgram.js`, "utf8"));
    for (const file of await readdir(`${folder}ShaderLib`)) {
        if (!UNUSED.test(`ShaderLib/${file}`)) await follow(await readFile(`${folder}ShaderLib/${file}`, "utf8"));
    }
    return found;
}

/** Takes three.js from its sources, and only the shaders that the page uses. @type {import("esbuild").Plugin} */
const small = {
    name: "small",
    async setup(build) {
        const used = await piecesUsed();
        build.onResolve({ filter: /^three$/ }, () => ({ path: `${THREE}Three.js` }));
        build.onLoad({ filter: /(WebXRManager|WebGLShadowMap|PMREMGenerator)\.js$/ }, ({ path }) =>
            ({ contents: LEFT_OUT[basename(path, ".js")], resolveDir: dirname(path) }));
        build.onLoad({ filter: /\.glsl\.js$/ }, async ({ path }) => {
            const [, piece] = /ShaderChunk.(\w+)\.glsl\.js$/.exec(path) ?? [];
            const left = UNUSED.test(path) || (piece && (NEVER.test(piece) || !used.has(piece)));
            const text = await readFile(path, "utf8");
            return { contents: text.replace(SHADER, (_, shader) => JSON.stringify(left ? "" : short(shader))) };
        });
    },
};

/** @param {string} entry @param {string} kind */
async function bundle(entry, kind) {
    const { outputFiles } = await build({
        entryPoints: [fileURLToPath(new URL(entry, import.meta.url))],
        bundle: true,
        minify: true,
        write: false,
        format: "iife",
        target: "es2022",
        charset: "utf8",
        plugins: [small],
        legalComments: "none", // the whole notices are in the page
    });
    const text = outputFiles[0].text.trim();
    if (text.includes(`</${kind}`)) throw new Error(`${entry}: the bundle has </${kind} in it`);
    return text;
}

async function page() {
    const script = await bundle("src/main.js", "script");
    const style = await bundle("style.css", "style");
    const hash = createHash("sha256").update(script).digest("base64");
    const notices = [
        ["three.js", await read("node_modules/three/LICENSE")],
        ["uPlot", await read("node_modules/uplot/LICENSE")],
        ["gifenc", await read("node_modules/gifenc/LICENSE.md")],
        ["@msgpack/msgpack", await read("node_modules/@msgpack/msgpack/LICENSE")],
    ];
    const text = notices.map(([name, licence]) => `${name}\n\n${licence}`).join("\n\n----\n\n");
    const policy = [
        "default-src 'none'",
        `script-src 'sha256-${hash}' 'wasm-unsafe-eval'`,
        "style-src 'unsafe-inline'",
        "img-src data: blob:",
        "media-src blob:",
    ].join("; ");
    /** @type {Record<string, string>} */
    const parts = {
        "@@NOTICES@@": `This page contains parts of other works, under these licences.\n\n${text}\n`,
        "@@POLICY@@": policy,
        "@@STYLE@@": style,
        "@@SCRIPT@@": script,
    };
    let html = await read("index.html");
    for (const [place, value] of Object.entries(parts)) html = html.split(place).join(value);
    for (const place of PLACES) {
        if (html.split(place).length !== 2) throw new Error(`${place} is not exactly once in the page`);
    }
    return `${html}\n`;
}

const html = await page();
if (process.argv.includes("--check")) {
    const written = await readFile(target, "utf8").catch(() => "");
    if (written !== html) {
        console.error("p3dof/page/page.html is not what page/ builds: run `make page` and commit it");
        process.exit(1);
    }
} else {
    await writeFile(target, html);
    console.log(`wrote p3dof/page/page.html: ${(html.length / 1000).toFixed(0)} kB`);
}
