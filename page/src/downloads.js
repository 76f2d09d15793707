// What can be taken out of the page: numbers, pictures, films, the scene, a link.
import { curvesCsv, motionColumns, motionCsv } from "./csv.js";
import { canEncode, draw, gif, video } from "./film.js";
import { glb } from "./glb.js";
import { runOf } from "./instant.js";
import { hashOf, leftOut } from "./links.js";
import { make, write } from "./make.js";
import { chartsPicture } from "./pictures.js";
import { fileName, pngOf, save } from "./save.js";

/** @typedef {import("./types").State} State */
/** @typedef {(job: import("./film").Job) => unknown} Act */

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    const name = () => fileName(`${state.document.machine.name} ${runOf(state)?.name ?? ""}`);
    const said = make("p", { className: "note", role: "status" });
    const bar = make("progress", { max: 1, value: 0, "aria-label": "Progress" });
    const cancel = make("button", { type: "button" }, "Cancel");
    const film = make("div", { className: "film", hidden: true }, bar, cancel);
    /** @type {import("./film").Job | null} */
    let job = null;
    cancel.addEventListener("click", () => job && (job.cancelled = true));

    /** @param {string} label @param {string} title @param {Act} act @param {boolean} [can] */
    const button = (label, title, act, can = true) => make("button", { type: "button", title, disabled: !can, onclick: () => run(act) }, label);

    /** @param {Act} act */
    async function run(act) {
        if (job) return;
        const mine = job = { cancelled: false, progress: (share) => void (bar.value = share) };
        write(said, "");
        try {
            const told = await act(mine);
            if (told instanceof HTMLElement) {
                said.replaceChildren(told);
                told.querySelector("input")?.select();
            } else write(said, mine.cancelled ? "Cancelled." : String(told ?? ""));
        } catch (error) {
            write(said, `This could not be done: ${error instanceof Error ? error.message : error}`);
        } finally {
            job = null;
            film.hidden = true;
        }
    }

    /** @param {(state: State, job: import("./film").Job) => Promise<Blob | null>} make_ @param {string} ending @returns {Act} */
    const filmed = (make_, ending) => async (mine) => {
        film.hidden = false;
        bar.value = 0;
        const blob = await make_(state, mine);
        if (!blob) return "";
        save(`${name()}.${ending}`, blob);
        return `${name()}.${ending}: ${Math.ceil(blob.size / 1000)} kB`;
    };

    const seen = Boolean(state.stage);
    const motion = button("Motion CSV", "the motion, as p3dof reads it with --motion", () =>
        save(`${name()}-motion.csv`, motionCsv(state.document, runOf(state)) ?? "", "text/csv"));
    element.append(
        make("h2", {}, "Save"),
        make("div", { className: "saves" },
            button("Curves CSV", "all curves of the run, SI units", () => save(`${name()}.csv`, curvesCsv(runOf(state)), "text/csv")),
            motion,
            button("Charts PNG", "the charts as a picture", async () => save(`${name()}-charts.png`, await pngOf(chartsPicture(state)))),
            button("3D PNG", "the 3D picture", async () => save(`${name()}.png`, await pngOf(scenePicture(state))), seen),
            button("GIF", "the motion as a film, at the speed of the time bar", filmed(gif, "gif"), seen),
            button("MP4", canEncode() ? "the motion as a film, at the speed of the time bar" : "this browser cannot encode films: take the GIF",
                filmed(video, "mp4"), seen && canEncode()),
            button("glTF", "scene and motion for other programs, .glb", () => save(`${name()}.glb`, new Blob([glb(state)], { type: "model/gltf-binary" }))),
            button("Link", "a link to this instant", () => copied(state))),
        film, said,
    );
    state.subscribe((_, changed) => {
        if (changed.has("document") || changed.has("run")) motion.disabled = !motionColumns(state.document, runOf(state));
    });
}

/** The 3D picture as it is. @param {State} state */
function scenePicture(state) {
    state.stage.refine();
    const picture = make("canvas", { width: state.stage.canvas.width, height: state.stage.canvas.height });
    draw(picture, state);
    return picture;
}

/** @param {State} state */
async function copied(state) {
    const hash = hashOf(state), without = leftOut(state);
    const link = location.href.replace(/#.*$/, "") + hash;
    try {
        history.replaceState(history.state, "", hash);
    } catch {
        // a page within a page has no address of its own
    }
    try {
        await navigator.clipboard.writeText(link);
        return `Copied: ${hash}${without && `. ${without}`}`;
    } catch {
        const field = make("input", { type: "text", readOnly: true, value: link, "aria-label": "Link to this instant" });
        return make("span", {}, field, without && ` ${without}`);
    }
}
