// The waypoints in the picture: a dot and a number each.
import { Mesh, MeshBasicMaterial, SphereGeometry } from "three";
import { Text } from "./labels.js";
import { engineOf } from "./solving.js";

const COLOUR = "#7b1fa2", PASSED = "#b67bd0";

/** @param {HTMLElement} _element @param {import("./types").State} state */
export function mount(_element, state) {
    const { stage } = state;
    if (!stage || !engineOf(state)) return;
    const size = 0.02 * state.document.scene.radius, ball = new SphereGeometry(0.45 * size, 16, 12);
    const colours = [COLOUR, PASSED].map((color) => new MeshBasicMaterial({ color, depthTest: false }));
    /** @type {{dot: Mesh, text: Text}[]} */
    const marks = [];
    state.subscribe((_, changed) => {
        const engine = engineOf(state), { waypoints } = state.task;
        if (!engine || !["task", "solved", "document"].some((name) => changed.has(name))) return;
        while (marks.length < waypoints.length) {
            const dot = new Mesh(ball, colours[0]), text = new Text(String(marks.length + 1), COLOUR);
            dot.renderOrder = 9;
            text.resize(2.2 * size);
            stage.guests.add(dot, text.sprite);
            marks.push({ dot, text });
        }
        marks.forEach(({ dot, text }, k) => {
            dot.visible = text.sprite.visible = k < waypoints.length;
            if (!dot.visible) return;
            const [y, z] = waypoints[k].pose, height = z - engine.lengths.h;
            dot.material = colours[waypoints[k].blend ? 1 : 0];
            dot.position.set(0, y, height);
            text.write(String(k + 1), COLOUR, stage.style.halo);
            text.sprite.position.set(0, y, height + 1.7 * size);
        });
        stage.redraw();
    });
}
