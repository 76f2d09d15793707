// Builds p3dof/viewer/document/page.html and studio.html, files with all scripts and styles in them, and THIRD-PARTY.md, the
// works in them and their licences. `--check` only compares.
import { createHash } from "node:crypto";
import { readFile, readdir, writeFile } from "node:fs/promises";
import { basename, dirname } from "node:path";
import process from "node:process";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

/** The pages: their parts, whose works are in them, and what Python fills in, in this order. */
const PAGES = [
    {
        target: "page.html",
        frame: "index.html",
        script: "src/main.js",
        style: "style.css",
        wasm: " 'wasm-unsafe-eval'",
        notices: {
            "three.js": ["three/LICENSE"],
            uPlot: ["uplot/LICENSE"],
            gifenc: ["gifenc/LICENSE.md"],
            "@msgpack/msgpack": ["@msgpack/msgpack/LICENSE"],
        },
        places: ["@@TITLE@@", "@@ENGINE@@", "@@DOCUMENT@@"],
    },
    {
        target: "studio.html",
        frame: "studio.html",
        script: "src/studio/main.js",
        style: "studio.css",
        wasm: "",
        notices: {
            "Apache ECharts": ["echarts/NOTICE", "echarts/LICENSE", "echarts/licenses/LICENSE-d3"],
            zrender: ["zrender/LICENSE"],
            tslib: ["tslib/LICENSE.txt"],
        },
        places: ["@@TITLE@@", "@@DOCUMENT@@"],
    },
];

/** @typedef {typeof PAGES[number]} Page */

/** @param {Page} page */
const pathOf = ({ target }) => `p3dof/viewer/document/${target}`;

/** @param {string} path relative to the repository */
const fileOf = (path) => fileURLToPath(new URL(`../${path}`, import.meta.url));

/** @param {string} path relative to this file */
const read = async (path) => (await readFile(new URL(path, import.meta.url), "utf8")).trim();

const THREE = fileURLToPath(new URL("node_modules/three/src/", import.meta.url));
/** What of three.js no material of the page needs: shaders, and pieces of them for what is never switched on. */
const UNUSED = /ShaderLib.(backgroundCube|cube|distance|equirect|linedashed|meshmatcap|meshphysical|meshtoon|shadow|vsm)\.glsl\.js$/;
const NEVER = /^(shadowmap|tonemapping_pars|envmap|bumpmap|displacementmap|aomap|lightmap|lightprobes|morph|skin|batching|fog|alphahash|logdepthbuf)/;
/** What stands in the place of virtual reality, shadows, mirrored surroundings, effects, morphing and shared uniforms. @type {Record<string, string>} */
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
    DFGLUTData: "export const getDFGLUT = () => null;",
    WebGLOutput: "export class WebGLOutput {}",
    WebGLEnvironments: `export function WebGLEnvironments() {
            return { get: (texture) => texture ?? null, dispose() {} };
        }`,
    WebGLMorphtargets: `export function WebGLMorphtargets() {
            return { update() {} };
        }`,
    WebGLUniformsGroups: `export function WebGLUniformsGroups() {
            return { dispose() {} };
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
        build.onLoad({ filter: /(WebXRManager|WebGLShadowMap|PMREMGenerator|DFGLUTData|WebGLEnvironments|WebGLMorphtargets|WebGLOutput|WebGLUniformsGroups)\.js$/ }, ({ path }) =>
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
    const { outputFiles, metafile } = await build({
        entryPoints: [fileURLToPath(new URL(entry, import.meta.url))],
        bundle: true,
        minify: true,
        write: false,
        metafile: true,
        format: "iife",
        target: "es2022",
        charset: "utf8",
        plugins: [small],
        legalComments: "none", // the whole notices are in the page
    });
    const text = outputFiles[0].text.trim();
    if (text.includes(`</${kind}`)) throw new Error(`${entry}: the bundle has </${kind} in it`);
    /** @type {Set<string>} */
    const works = new Set();
    for (const [path, { bytesInOutput }] of Object.entries(Object.values(metafile.outputs)[0].inputs)) {
        const [, name] = /node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(path) ?? [];
        if (name && bytesInOutput) works.add(name);
    }
    return { text, works };
}

/** Packages whose licences are among the notices. @param {Page} page */
const worksOf = ({ notices }) => Object.values(notices).map(([path]) => /^(?:@[^/]+\/)?[^/]+/.exec(path)?.[0] ?? path);

/** @param {string} name @param {string[]} paths */
async function noticeOf(name, paths) {
    const parts = await Promise.all(paths.map((path) => read(`node_modules/${path}`)));
    return [name, ...parts].join("\n\n");
}

/** What other works the pages have in them: versions and licences as in package-lock.json, and their notices whole. */
async function thirdParties() {
    const { packages } = JSON.parse(await read("package-lock.json"));
    const rows = [];
    const texts = [];
    for (const about of PAGES) {
        for (const [i, work] of worksOf(about).entries()) {
            const { version, license } = packages[`node_modules/${work}`];
            rows.push(`| ${work} | ${version} | ${license} | \`${pathOf(about)}\` |`);
            const [name, paths] = Object.entries(about.notices)[i];
            texts.push(`## ${work}\n\n\`\`\`text\n${(await noticeOf(name, paths)).replace(/[ \t]+$/gm, "")}\n\`\`\``);
        }
    }
    return `# Works of others in the package

p3dof is under the [BSD 2-Clause licence](LICENSE). The pages that it writes hold these works, bundled from \`page/\`; each page
carries their notices. \`make page\` writes this file from \`page/package-lock.json\`.

| work | version | licence | in |
|---|---|---|---|
${rows.join("\n")}

${texts.join("\n\n")}
`;
}

/** @param {Page} about */
async function page(about) {
    const { frame, script: entry, style: sheet, wasm, notices, places } = about;
    const { text: script, works } = await bundle(entry, "script");
    const { text: style, works: styles } = await bundle(sheet, "style");
    const [held, noticed] = [[...new Set([...works, ...styles])], worksOf(about)].map((names) => names.sort().join(", "));
    if (held !== noticed) throw new Error(`${about.target} holds ${held}, but its notices are of ${noticed}`);
    const hash = createHash("sha256").update(script).digest("base64");
    const texts = await Promise.all(Object.entries(notices).map(([name, paths]) => noticeOf(name, paths)));
    const policy = [
        "default-src 'none'",
        `script-src 'sha256-${hash}'${wasm}`,
        "style-src 'unsafe-inline'",
        "img-src data: blob:",
        "media-src blob:",
    ].join("; ");
    /** @type {Record<string, string>} */
    const parts = {
        "@@NOTICES@@": `This page contains parts of other works, under these licences.\n\n${texts.join("\n\n----\n\n")}\n`,
        "@@POLICY@@": policy,
        "@@STYLE@@": style,
        "@@SCRIPT@@": script,
    };
    let html = await read(frame);
    for (const [place, value] of Object.entries(parts)) html = html.split(place).join(value);
    for (const place of places) {
        if (html.split(place).length !== 2) throw new Error(`${place} is not exactly once in ${frame}`);
    }
    return `${html}\n`;
}

/** @type {[string, string][]} */
const made = [["THIRD-PARTY.md", await thirdParties()]];
for (const about of PAGES) made.push([pathOf(about), await page(about)]);
for (const [path, text] of made) {
    if (process.argv.includes("--check")) {
        const written = await readFile(fileOf(path), "utf8").catch(() => "");
        if (written !== text) {
            console.error(`${path} is not what page/ builds: run \`make page\` and commit it`);
            process.exit(1);
        }
    } else {
        await writeFile(fileOf(path), text);
        console.log(`wrote ${path}: ${(text.length / 1000).toFixed(0)} kB`);
    }
}
