// What is in a document, decoded, and what the parts of the page share. SI units and radians.
export type Numbers = Float64Array | Float32Array | Int8Array | Uint8Array | Int16Array | Uint16Array | Int32Array | Uint32Array;
/** An array in C order. */
export interface Table { shape: number[]; data: Numbers }
export type Placement = number[]; // x y z qx qy qz qw

export type Kind = "revolute" | "prismatic" | "continuous" | "helical" | "spherical" | "translation" | "planar"
    | "free" | "universal" | "fixed" | "placed";
export interface Joint {
    name: string; body?: string; parent: number; placement: Placement; kind: Kind;
    axis?: number[]; axis2?: number[]; pitch?: number; q?: [number, number];
}
export type Shape =
    | { kind: "box"; size: number[] }
    | { kind: "cylinder" | "capsule"; radius: number; length: number }
    | { kind: "sphere"; radius: number }
    | { kind: "mesh"; positions: Table; indices: Table; scale?: number | number[]; offset?: number[] };
export interface Solid {
    name: string; joint: number; placement: Placement; shape: Shape; colour: string; opacity?: number; layer?: string;
    /** The leg that it belongs to, which turns red when it cannot follow. */
    leg?: string;
}
/** A point whose path over the run is drawn; of the paper's machine the point P, which can be dragged. */
export interface Traced { name: string; joint: number; point: number[]; colour: string; layer?: string }
export interface Label { text: string; at: number[]; joint?: number; height: number; colour?: string; layer?: string }
export interface Line { points: Table; joint?: number; colour?: string; layer?: string }
export interface Layer { name: string; label: string; shown: boolean }
export interface Scene {
    centre: number[]; radius: number; floor: number | null;
    joints: Joint[]; solids: Solid[]; labels: Label[]; lines: Line[]; layers: Layer[];
    traced?: Traced;
}
export interface Curve {
    key: string; label: string; group: string; unit: string; values: Table; column?: [string, number]; colour?: string;
    limit?: [number | null, number | null];
}
export interface Load {
    key: string; label: string; kind: "force" | "moment"; joint: number; point: number[]; frame: "world" | "joint";
    direction?: number[]; curve?: string; values?: Table; colour?: string;
    group: "actuator" | "multiplier" | "reaction" | "wrench"; unit: string; layer?: string;
}
/** Points (N, 6) of two parts and their distances (N,) [m]; which of `names` these are, (N,); the least that is required [m]. */
export interface Near { points: Table; distances: Table; pairs: Table; names: string[]; required: number }
export interface Run {
    name: string; time: Table; q: Table; pose?: Table; velocity?: Table; acceleration?: Table; wrench?: Table;
    curves: Curve[]; loads: Load[]; notes: string[]; placed?: Record<string, Table>;
    /** Which parts are nearest to each other at each sample, and where. */
    nearest?: Near;
    /** Made in this page, with this machine: waypoints, or a run that was kept. */
    computed?: "waypoints" | "kept";
    /** Which one of the file's it is, from one, since one of them was removed from the page. */
    number?: number;
    /** How its machine differs from the document's, or from `parameters` where these are. */
    machine?: WhatIf;
    /** The numbers of its machine, where it is another one than the document's, and what its solids are made of. */
    parameters?: Table;
    solids?: OfSolids;
}
/** Densities of solids [kg/m^3], and those of their sizes that do not follow from the lengths [m]. */
export interface OfSolids {
    density: { slider: number; leg: number; crossbar: number; platform: number };
    dimensions: { slider_edge?: number; rod_radius?: number; plate_thickness?: number; corner_radius?: number };
}
export interface Closure {
    name: string; kind: string; joint1: number; placement1: Placement; joint2: number; placement2: Placement;
}
export interface Input {
    key: string; label: string; unit: string; low: number; high: number; value: number; joint?: number;
}
export interface Limits { travel?: [number, number]; speed?: number; force?: number; tilt?: [number, number] }
/** Where a page begins in its first run: time [s], seconds of the run in a second; what is seen at first. */
export interface Start { time?: number; speed?: number; playing?: boolean; layers?: Record<string, boolean> }
export interface Document {
    start?: Start;
    format: 1; title: string; generator: Record<string, string>; machine: { name: string; hash: string };
    scene: Scene; runs: Run[]; closures: Closure[]; inputs: Input[]; limits: Limits;
    engine: { kind: "p3dof"; parameters: Table; solids?: OfSolids } | LoopEngine | { kind: "ask" } | { kind: "none"; why?: string };
}
/** What a page needs to move a robot by itself. */
export interface LoopEngine {
    kind: "loop"; module: Table; nq: number; nv: number;
    v: [number, number][]; motors: number[]; effort: (number | null)[]; limits: [number | null, number | null][]; rows: number[]; rank: number | null;
    entries: Table; mass: Table; gravity: number[]; inertias: Table;
    external: { frame: string; joint: number; point: number[]; wrench: number[] }[];
    check: { q: Table; v: Table; tau: Table; a: Table; forces: Table };
}

/** What a pose by hand could not do, and which legs are to blame ("a", "b", "c"). */
export interface Refusal { text: string; legs: string[] }
/** The platform or the joints as somebody holds them, instead of the run. */
export type Hand = { pose: number[] } | { q: number[] };
/** What is recomputed with other parameters than the document's; absent: as in the document. */
export type WhatIf = import("./machine.js").WhatIf;
/** "free": turned by hand. */
export type View = "3d" | "front" | "side" | "top" | "free";
/** What a chart shows: curves of a group, without the hidden ones; over another curve, or over time where none is named. */
export interface ChartChoice { group: string; hidden: string[]; over: string }

/** A coloured picture in the plane x = 0 of the fixed frame, drawn in 3D: rows go up in z. */
export interface Picture {
    y: [number, number]; z: [number, number]; width: number; height: number; rgba: Uint8Array;
}

export interface Fields {
    document: Document;
    /** Index of the run that is shown. */
    run: number;
    /** Of the run that is shown [s]. */
    time: number;
    playing: boolean;
    /** How many seconds of the run go by in a second. */
    speed: number;
    loop: boolean;
    hand: Hand | null;
    /** Why the hand did not go where it was moved last. */
    refused: Refusal | null;
    whatIf: WhatIf;
    /** The run that is shown, recomputed in the page; null: as in the document. */
    solved: Run | null;
    /** What the recomputed run was in the document, the same part of the forces: drawn dashed; null: nothing to draw. */
    before: Run | null;
    /** What recomputing came to; null without an engine, or a run that it cannot compute. */
    report: import("./resolve.js").Report | null;
    case: "total" | "static" | "dynamic";
    units: "mm" | "SI";
    theme: "auto" | "light" | "dark";
    /** By name: those of the document's scene and the page's own: forces, map, closures, section, parallel. */
    layers: Record<string, boolean>;
    view: View;
    charts: ChartChoice[];
    /** Index of a run to compare with. */
    compare: number | null;
    /** Whether charts show what differs from it, instead of both. */
    difference: boolean;
    /** What the charts show of the run [s]; null: all of it. */
    zoom: [number, number] | null;
    /** Why a link could not be followed; empty where it could. */
    linked: string;
    /** Whether the list of keys is open. */
    help: boolean;
    /** Instant under the pointer in a chart [s]. */
    hover: number | null;
    /** What the platform is to do, and how fast; what planning came to, null with fewer than two waypoints. */
    task: import("./plan.js").Task;
    pace: import("./plan.js").Pace;
    planned: import("./planning.js").Planned | null;
    /** What the workspace map shows: the largest force that holds a pose, the least margin, or what is possible. */
    shade: "force" | "margin" | "status";
    /** The workspace map in 3D. */
    map: Picture | null;
    /** The forces in the page; null without. */
    engine: any;
    /** Set by the 3D part: three's scene, camera, renderer, a group for guests, and what asks for another frame. */
    stage: any;
    /** To a Python behind the page; null without. */
    connection: import("./connection").Connection | null;
    /** Draws a packed command of MeshCat; null without 3D. */
    guests: ((command: Uint8Array) => void) | null;
}
export interface State extends Fields {
    /** Counts the changes. */
    version: number;
    set(changes: Partial<Fields>): void;
    subscribe(listener: (state: State, changed: Set<string>) => void): () => void;
    /** Does at once what would be done in the next animation frame. */
    refresh(): void;
}
/** A force or a moment at an instant, in the fixed frame. */
export interface ShownLoad { load: Load; at: number[]; vector: number[]; value: number }
export interface Instant {
    time: number; run: Run; byHand: boolean;
    q: Float64Array; pose: number[] | null;
    /** 4x4 matrices in columns, one after the other, of all joints in the fixed frame. */
    placements: Float64Array;
    /** Of the run's curves, by key; NaN where there is none (when it is moved by hand without an engine). */
    values: Record<string, number>;
    loads: ShownLoad[];
}
