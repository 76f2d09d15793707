// A Python behind the page: it sends runs and other documents, and answers what the page cannot compute.
// Without one, or when it stops, the page goes on with what it has.
import { AskEngine } from "./ask.js";
import { read, readRun } from "./document.js";
import { load } from "./engine.js";
import { follow } from "./links.js";
import { unpacked } from "./messages.js";
import { within } from "./state.js";

/** @typedef {import("./types").State} State */
/**
 * What carries messages: `send` gives up silently where there is nobody.
 * @typedef {{send(message: object): void}} Carrier
 */

const AGAIN = [500, 1000, 2000, 4000]; // how long to wait before the next attempt [ms]

/** @param {HTMLElement} element @param {State} state */
export function mount(element, state) {
    const [kind, version] = marked();
    window.addEventListener("message", (event) => {
        const hash = event.source === window.parent ? event.data?.p3dof?.hash : null;
        if (typeof hash === "string") follow(state, hash); // a link of the page around this one
    });
    if (kind === "none") return;
    const connection = new Connection(element, state, Number(version));
    state.connection = connection;
    if (kind === "server") new Socket(connection);
    else new Parent(connection);
}

/** How the page was made: "none", or what carries messages and the version of its document. */
function marked() {
    const content = document.querySelector('meta[name="p3dof-connection"]')?.getAttribute("content") ?? "none";
    return content.split(" ");
}

/** @param {State} state @param {number} time */
function seek(state, time) {
    state.set({ time: within(state, time), playing: false, hand: null });
}

export class Connection {
    /** @param {HTMLElement} element @param {State} state @param {number} version of the document in the page */
    constructor(element, state, version) {
        this.state = state;
        this.version = version;
        this.open = false;
        this.follow = false;
        /** @type {Carrier | null} */
        this.carrier = null;
        /** @type {Map<number, (answer: any) => void>} */
        this.asked = new Map();
        this.count = 0;
        this.said = "";
        this.note = element.ownerDocument.createElement("p");
        this.note.className = "connection";
        this.note.setAttribute("role", "status");
        element.append(this.note);
        this.tell("connecting to Python …");
        state.subscribe((_, changed) => {
            this.tellSelection(changed);
            if (this.follow && changed.has("task")) this.sendWaypoints(state.task?.waypoints ?? []);
        });
    }

    /** @param {string} text */
    tell(text) {
        this.note.textContent = text;
    }

    /** @param {Carrier} carrier */
    opened(carrier) {
        this.carrier = carrier;
        this.open = true;
        this.tell("connected to Python");
        if (!this.state.engine) this.state.set({ engine: this.asking() });
    }

    /** @param {string} why */
    closed(why) {
        this.open = false;
        for (const answer of this.asked.values()) answer({ refused: "Python has stopped answering" });
        this.asked.clear();
        const goesOn = this.state.document.engine.kind === "ask" ? "what is stored is shown" : "the page goes on by itself";
        this.tell(`${why}: ${goesOn}`);
        if (this.state.engine instanceof AskEngine) this.state.set({ engine: null });
    }

    /**
     * Ask Python; the answer to an earlier question may never come.
     * @param {object} question
     * @returns {Promise<any>}
     */
    ask(question) {
        if (!this.open) return Promise.resolve({ refused: "no Python answers" });
        const id = ++this.count;
        return new Promise((resolve) => {
            this.asked.set(id, resolve);
            this.carrier?.send({ type: "ask", id, ...question });
        });
    }

    /** @param {unknown[]} waypoints */
    sendWaypoints(waypoints) {
        if (this.open) this.carrier?.send({ type: "waypoints", waypoints });
    }

    /** @param {any} message */
    received(message) {
        const { state } = this;
        if (message.type === "hello") {
            this.follow = message.follow;
            if (message.version !== this.version) this.carrier?.send({ type: "get" });
            this.tellSelection(new Set(["time"]));
        } else if (message.type === "document") this.replace(message);
        else if (message.type === "run") this.addRun(message);
        else if (message.type === "seek") seek(state, message.time);
        else if (message.type === "guest") state.guests?.(message.command.bytes);
        else if (message.type === "answer") {
            for (const id of [...this.asked.keys()]) {
                if (id < message.id) this.asked.delete(id); // nobody answers what was asked before
            }
            this.asked.get(message.id)?.(message);
            this.asked.delete(message.id);
        } else if (message.type === "error") this.tell(message.message);
    }

    /** @param {any} message */
    replace({ version, document }) {
        this.version = version;
        const shown = read(document);
        window.document.title = shown.title;
        const run = Math.max(Math.min(this.state.run, shown.runs.length - 1), 0);
        void load(shown, window.document.getElementById("p3dof-wasm")?.textContent?.trim() ?? "", this.state).catch(() => null)
            .then((engine) => this.state.set({ document: shown, run, engine: engine ?? this.asking(), ...AT_REST }));
    }

    /** An engine that asks Python, while there is one. */
    asking() {
        return this.open ? new AskEngine(this, this.state) : null;
    }

    /** @param {any} message */
    addRun({ version, index, run }) {
        this.version = version;
        const { document } = this.state;
        if (index > document.runs.length) return;
        const runs = document.runs.slice();
        runs[index] = readRun(run, index, document);
        this.state.set({ document: { ...document, runs }, run: index, ...AT_REST });
    }

    /** Tell Python what is looked at, if it wants to know. @param {Set<string>} changed */
    tellSelection(changed) {
        if (!this.follow || !this.open) return;
        if (!["time", "run", "hand", "document"].some((field) => changed.has(field))) return;
        const { time, run, hand } = this.state;
        const selection = { type: "selection", time, run, ...plain(hand) };
        const text = JSON.stringify(selection);
        if (text !== this.said) this.carrier?.send(selection);
        this.said = text;
    }
}

const AT_REST = /** @type {const} */ ({ solved: null, hand: null, compare: null, hover: null });

/** @param {State["hand"]} hand */
function plain(hand) {
    if (!hand) return {};
    return "pose" in hand ? { pose: Array.from(hand.pose) } : { q: Array.from(hand.q) };
}

/** The server that the page came from. */
class Socket {
    /** @param {Connection} connection */
    constructor(connection) {
        this.connection = connection;
        this.attempts = 0;
        this.token = keptToken();
        this.connect();
    }

    connect() {
        const socket = new WebSocket(`ws://${location.host}/page?token=${encodeURIComponent(this.token)}`);
        socket.binaryType = "arraybuffer";
        socket.onopen = () => {
            this.attempts = 0;
            this.connection.opened({ send: (message) => socket.readyState === 1 && socket.send(JSON.stringify(message)) });
        };
        socket.onmessage = ({ data }) => this.connection.received(typeof data === "string" ? JSON.parse(data) : unpacked(data));
        socket.onclose = ({ reason }) => {
            this.connection.closed(reason || "Python is gone");
            setTimeout(() => this.connect(), AGAIN[Math.min(this.attempts++, AGAIN.length - 1)]);
        };
    }
}

/** The token of this page's address, taken out of it and kept for when the page is loaded again. */
function keptToken() {
    const address = new URL(location.href);
    const token = address.searchParams.get("token");
    try {
        if (token) sessionStorage.setItem("p3dof-token", token);
        if (token) history.replaceState(null, "", address.pathname + address.hash);
        return token ?? sessionStorage.getItem("p3dof-token") ?? "";
    } catch {
        return token ?? ""; // no storage: the address keeps it
    }
}

/** A page around this one, which passes messages on: a widget of a notebook. */
class Parent {
    /** @param {Connection} connection */
    constructor(connection) {
        window.addEventListener("message", ({ source, data }) => {
            if (source !== window.parent) return;
            if (data instanceof ArrayBuffer) connection.received(unpacked(data));
            else if (data?.p3dof === "closed") connection.closed("Python has ended it");
        });
        connection.opened({ send: (message) => window.parent.postMessage({ p3dof: message }, "*") });
        connection.carrier?.send({ type: "hello" });
    }
}
