// Loads a URDF with urdf-loader and prints the world poses of some links, column by column, and how many meshes it drew.
// node urdf_loader.mjs FOLDER_OF_NODE_MODULES URDF JOINTS_AS_JSON LINK...
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
import { dirname, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [place, urdf, joints, ...links] = process.argv.slice(2);
const modules = resolve(place, "node_modules");
const load = (path) => import(pathToFileURL(resolve(modules, path)).href);
const { JSDOM } = createRequire(resolve(modules, "jsdom/package.json"))("jsdom");
const window = new JSDOM("").window;
Object.assign(globalThis, { DOMParser: window.DOMParser, Document: window.Document, Element: window.Element });
const three = await load("three/build/three.module.js");
const { default: URDFLoader } = await load("urdf-loader/src/URDFLoader.js");
const { STLLoader } = await load("three/examples/jsm/loaders/STLLoader.js");

const loader = new URDFLoader();
loader.workingPath = dirname(urdf) + "/";
loader.loadMeshCb = (path, ...rest) => {
  const bytes = readFileSync(path);
  const geometry = new STLLoader().parse(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
  rest.findLast((one) => typeof one === "function")(new three.Mesh(geometry, new three.MeshBasicMaterial()));
};
const robot = loader.parse(readFileSync(urdf, "utf-8"));
robot.setJointValues(JSON.parse(joints));
robot.updateMatrixWorld(true);
let visuals = 0;
robot.traverse((part) => { visuals += part.isURDFVisual && part.children.length ? 1 : 0; });
const answer = { visuals };
for (const link of links) answer[link] = robot.links[link].matrixWorld.elements;
console.log(JSON.stringify(answer));
