// Drawings of MeshCat's commands in the scene: what other programs show beside the machine.
import { ExtensionCodec, decode } from "@msgpack/msgpack";
import { Group } from "three";
import { disposed, objectOf, paint } from "./guest_objects.js";

/** @typedef {import("./types").State} State */

/** MeshCat's own furniture, of which the page has its own. */
const FURNITURE = new Set(["Background", "Grid", "Axes", "Lights", "Cameras"]);
const OBJECT = "<object>";

const codec = new ExtensionCodec();
for (const [type, Type] of /** @type {const} */ ([[0x12, Uint8Array], [0x15, Int32Array], [0x16, Uint32Array], [0x17, Float32Array]])) {
    codec.register({ type, encode: () => null, decode: (bytes) => new Type(bytes.slice().buffer) });
}

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    if (!state.stage?.guests) return;
    const guests = new Guests(state.stage.guests);
    const said = element.ownerDocument.createElement("p");
    said.className = "note guests";
    said.hidden = true;
    element.append(said);
    state.guests = (command) => {
        try {
            guests.take(command);
        } catch (error) {
            said.textContent = error instanceof Error ? error.message : String(error);
            said.hidden = false;
        }
        state.stage.redraw();
    };
}

/** A tree of what MeshCat's commands have drawn. */
export class Guests {
    /** @param {Group} root in metres, with the axes of the fixed frame */
    constructor(root) {
        this.root = root;
    }

    /** Do what a packed command says. @param {Uint8Array} bytes */
    take(bytes) {
        const command = /** @type {any} */ (decode(bytes, { extensionCodec: codec }));
        const path = String(command.path ?? "").split("/").filter(Boolean);
        if (FURNITURE.has(path[0])) return;
        if (command.type === "delete") this.forget(path);
        else if (command.type === "set_transform") place(this.at(path), command.matrix);
        else if (command.type === "set_object") this.draw(path, command.object);
        else if (command.type === "set_property") change(this.at(path), command.property, command.value);
    }

    /** The node at a path, made if there is none. @param {string[]} path @returns {Group} */
    at(path) {
        let node = this.root;
        for (const name of path) {
            let next = /** @type {Group | undefined} */ (node.children.find((child) => child.name === name));
            if (!next) {
                next = new Group();
                next.name = name;
                node.add(next);
            }
            node = next;
        }
        return node;
    }

    /** @param {string[]} path @param {any} data */
    draw(path, data) {
        const made = objectOf(data);
        made.name = OBJECT;
        this.forget([...path, OBJECT]);
        this.at(path).add(made);
    }

    /** @param {string[]} path */
    forget(path) {
        /** @type {any} */
        let node = this.root;
        for (const name of path) node = node?.children.find((/** @type {any} */ child) => child.name === name);
        if (!node) return;
        disposed(node);
        if (node === this.root) this.root.clear();
        else node.removeFromParent();
    }
}

/** @param {Group} node @param {number[]} matrix in columns */
function place(node, matrix) {
    node.matrix.fromArray(matrix);
    node.matrix.decompose(node.position, node.quaternion, node.scale);
}

/** @param {any} node @param {string} property @param {any} value */
function change(node, property, value) {
    if (property === "visible") node.visible = Boolean(value);
    else if (property === "color") paint(node, value);
    else if (property === "opacity" || property === "modulated_opacity") {
        node.traverse((/** @type {any} */ one) => {
            if (one.material) Object.assign(one.material, { opacity: value, transparent: value < 1, needsUpdate: true });
        });
    } else if (property === "position" || property === "scale") node[property].fromArray(value);
    else if (property === "quaternion") node.quaternion.fromArray(value);
}
