/* The browser's half of the explorer: fields, pictures and menus as Vue components over trame's state.
   It decides nothing about a design; it asks the server, one request at a time, and of a slider only the last place. */
(function () {
  "use strict";
  const { inject, reactive, onMounted, onBeforeUnmount, ref, shallowRef, markRaw, toRaw, computed, watch, nextTick } = window.Vue;
  const root = document.documentElement;
  let trame = null;
  let tabKey = "";
  let title = "design";

  // Requests, in order. Of a gesture one is under way, and a later place replaces an earlier that still waits; a click
  // goes at once, with all that waits before it: the server leaves what it draws for an older one.
  const waiting = new Map();
  let underway = 0;
  let serial = 0;

  function ask(name, ...args) {
    waiting.set(`${name}#${serial++}`, [name, args]);
    while (trame && waiting.size) send();
  }

  function askAs(key, name, ...args) {
    waiting.delete(key);
    waiting.set(key, [name, args]);
    pump();
  }

  function pump() { if (trame && waiting.size && !underway) send(); }

  async function send() {
    const [key, [name, args]] = waiting.entries().next().value;
    waiting.delete(key);
    underway++;
    root.dataset.busy = "yes";
    try {
      await until(await trame.trigger(name, args));
    } catch (error) {
      say(`The request "${name}" failed; the terminal that runs roslf explore tells why.`);
    }
    underway--;
    if (!underway && !waiting.size) delete root.dataset.busy;
    pump();
  }

  // The answer to a request may overtake what it changed: wait until the page shows that, too.
  let shown = 0;
  let awaited = [];

  function until(serial) {
    return new Promise((done) => {
      if (shown >= serial) done(); else awaited.push({ serial, done });
    });
  }

  function hasShown(serial) {
    shown = serial;
    for (const { done } of awaited.filter((each) => each.serial <= shown)) done();
    awaited = awaited.filter((each) => each.serial > shown);
  }

  function say(text) {
    let place = document.getElementById("said");
    if (!place) {
      place = document.createElement("p");
      place.id = "said";
      place.setAttribute("role", "status");
      document.body.append(place);
    }
    place.textContent = text;
    place.classList.add("shown");
    clearTimeout(say.timer);
    say.timer = setTimeout(() => place.classList.remove("shown"), 6000);
  }

  // Light or dark: as chosen before, else as the system has it.
  function chosenTheme() {
    try {
      const kept = localStorage.getItem("roslf-theme");
      if (kept === "dark" || kept === "light") return kept;
    } catch { /* storage may be forbidden */ }
    return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  }
  root.dataset.theme = chosenTheme();

  function turnTheme() {
    const next = root.dataset.theme === "dark" ? "light" : "dark";
    root.dataset.theme = next;
    try { localStorage.setItem("roslf-theme", next); } catch { /* storage may be forbidden */ }
    ask("set_theme", next);
  }

  // Room of the pictures, told to the server when it changes.
  const boxes = new Map();
  const observer = new ResizeObserver(() => {
    clearTimeout(observer.timer);
    observer.timer = setTimeout(tellSizes, 80);
  });
  let told = "";

  function sizes() {
    const result = {};
    for (const [name, box] of boxes) {
      const { width, height } = box.getBoundingClientRect();
      if (width > 0 && height > 0) result[name] = [Math.round(width), Math.round(height)];
    }
    return result;
  }

  function tellSizes() {
    const now = sizes();
    const text = JSON.stringify(now);
    if (text === told || !opened) return;
    told = text;
    askAs("resize", "resize", now);
  }

  // Files.
  function save(blob, name) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = name;
    document.body.append(link);
    link.click();
    link.remove();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  async function fetched(name) {
    const answer = await fetch(`/tab/${tabKey}/${name}`);
    if (!answer.ok) throw new Error(await answer.text());
    const told = /filename="([^"]+)"/.exec(answer.headers.get("Content-Disposition") || "");
    return [await answer.blob(), told ? told[1] : name];
  }

  async function fetchFile(name, event) {
    const button = event && event.currentTarget;
    if (button && button.ariaBusy) return;
    if (button) button.setAttribute("aria-busy", "true");
    try {
      save(...(await fetched(name)));
    } catch (error) {
      say(`${name} could not be made: ${error.message}`);
    } finally {
      if (button) button.removeAttribute("aria-busy");
    }
  }

  async function fetchPng(name) {
    try {
      const [blob, file] = await fetched(`${name}.svg`);
      const image = new Image();
      image.src = URL.createObjectURL(blob);
      await image.decode();
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [2 * image.naturalWidth, 2 * image.naturalHeight];
      const pen = canvas.getContext("2d");
      pen.fillStyle = "#ffffff";
      pen.fillRect(0, 0, canvas.width, canvas.height);
      pen.drawImage(image, 0, 0, canvas.width, canvas.height);
      URL.revokeObjectURL(image.src);
      save(await new Promise((done) => canvas.toBlob(done, "image/png")), file.replace(/svg$/, "png"));
    } catch (error) {
      say(`${name}.png could not be made: ${error.message}`);
    }
  }

  async function copyLink() {
    try {
      await navigator.clipboard.writeText(location.href);
      say("The link is copied.");
    } catch {
      say("The browser does not allow copying; take the link from the address bar.");
    }
  }

  async function upload(event) {
    const [file] = event.target.files;
    event.target.value = "";
    closeMenus();
    if (file) ask("load_text", file.name, await file.text());
  }

  function path(event) {
    const text = event.target.elements.path.value;
    closeMenus();
    if (text.trim()) ask("load_path", text);
  }

  function preset(event) {
    const name = event.target.value;
    event.target.value = "";
    closeMenus();
    if (name) ask("load_path", name);
  }

  function closeMenus(but) {
    for (const menu of document.querySelectorAll("details.menu[open]")) if (menu !== but) menu.open = false;
  }

  function toViews() { document.getElementById("views").focus(); }

  function tabKeys(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const tabs = [...event.target.parentElement.querySelectorAll("[role=tab]")];
    const next = tabs[(tabs.indexOf(event.target) + step + tabs.length) % tabs.length];
    next.focus();
    next.click();
    event.preventDefault();
  }

  function turnSheet() { document.querySelector(".numbers").classList.toggle("open"); }

  // The view that is shown: changed at once, whatever the server is at.
  const view = reactive({ tab: "camera", fresh: [] });
  function due(name) { return !view.fresh.includes(name); }

  async function showTab(key) {
    view.tab = key;
    await nextTick();
    document.getElementById("views").scrollTop = 0;
    const now = sizes();
    told = JSON.stringify(now);
    ask("show", key, now);
  }

  // The address holds the state, so that reloading, bookmarks and links bring it back.
  let opened = false;
  let linked = "";

  const Shell = {
    props: ["link", "theme", "tab", "tabKey", "title", "answered", "fresh"],
    setup(props) {
      trame = inject("trame");
      tabKey = props.tabKey;
      watch(() => props.tabKey, (key) => { tabKey = key; });
      watch(() => props.title, (name) => { title = name.replace(/[^A-Za-z0-9._-]+/g, "-") || "design"; document.title = `${name} - roslf explore`; }, { immediate: true });
      watch(() => props.tab, (tab) => { view.tab = tab; }, { immediate: true });
      watch(() => props.fresh, (names) => { view.fresh = names; }, { immediate: true });
      watch(() => props.answered, hasShown, { flush: "post" });
      watch(() => props.link, (link) => {
        if (!opened || !link || link === linked) return;
        linked = link;
        clearTimeout(Shell.timer);
        // Browsers allow few changes of the address a second.
        Shell.timer = setTimeout(() => history.replaceState(null, "", `/#${linked}`), 150);
      });
      const moved = () => {
        const link = location.hash.slice(1);
        if (link && link !== linked) { linked = link; ask("restore", link); }
      };
      const keys = (event) => {
        const typing = event.target.matches && event.target.matches("input[type=text]");
        if (event.key === "Escape") closeMenus();
        if (typing || !(event.ctrlKey || event.metaKey)) return;
        const key = event.key.toLowerCase();
        if (key === "z") { ask(event.shiftKey ? "redo" : "undo"); event.preventDefault(); }
        if (key === "y") { ask("redo"); event.preventDefault(); }
        if (key === "s") { fetchFile("design.toml"); event.preventDefault(); }
      };
      const outside = (event) => closeMenus(event.target.closest && event.target.closest("details.menu"));
      onMounted(async () => {
        addEventListener("hashchange", moved);
        addEventListener("keydown", keys);
        addEventListener("pointerdown", outside);
        await nextTick();
        told = JSON.stringify(sizes());
        ask("opened", location.hash.slice(1), root.dataset.theme, sizes());
        opened = true;
      });
      onBeforeUnmount(() => {
        removeEventListener("hashchange", moved);
        removeEventListener("keydown", keys);
        removeEventListener("pointerdown", outside);
      });
      return {};
    },
    template: `<span hidden></span>`,
  };

  // One number: a slider and a field that takes units.
  const FieldView = {
    props: ["field"],
    setup(props) {
      const dragging = ref(false);
      const local = ref(props.field.position);
      const text = ref(props.field.text);
      const typing = ref(false);
      let gesture = "";
      let last = 0;
      let down = false;
      watch(() => props.field.text, (now) => { if (!typing.value) text.value = now; });
      const place = computed(() => (dragging.value ? local.value : props.field.position));
      function slide(event) {
        const now = performance.now();
        if (!gesture || (!down && now - last > 800)) gesture = `${props.field.symbol}:${serial++}`;
        last = now;
        dragging.value = true;
        local.value = Number(event.target.value);
        askAs(`slide ${props.field.symbol}`, "slide", props.field.symbol, local.value, gesture);
      }
      function grasp() { down = true; gesture = `${props.field.symbol}:${serial++}`; }
      function release() { down = false; settle(); }
      // The server's place takes over once it has answered all that was asked.
      function settle() {
        if (underway) { setTimeout(settle, 30); return; }
        if (!down) dragging.value = false;
      }
      function written(event) {
        typing.value = false;
        if (event.target.value !== props.field.text || props.field.fault) ask("write", props.field.symbol, event.target.value);
      }
      function typed(event) { typing.value = true; text.value = event.target.value; }
      function left() { typing.value = false; if (!props.field.fault) text.value = props.field.text; }
      function keys(event) {
        if (event.key === "Escape") { typing.value = false; text.value = props.field.shown; ask("write", props.field.symbol, props.field.shown); event.target.blur(); }
      }
      return { place, text, slide, grasp, release, written, typed, left, keys, ask };
    },
    template: `
<div class="field" :class="{ wrong: field.fault, shut: !field.open }" :data-field="field.symbol">
  <label :for="'n-' + field.symbol"><b v-if="field.markup" v-html="field.markup"></b> {{ field.name }}</label>
  <button v-if="field.can_follow" type="button" class="lock" :aria-pressed="field.follows" :title="field.follows ? 'Follows from the other two' : 'Let this one follow from the other two'" :aria-label="field.spoken + ' follows from the other two'" @click="ask('follow', field.symbol)"><svg viewBox="0 0 20 20" aria-hidden="true"><path v-if="field.follows" d="M8 12a3.500 3.500 0 0 0 5 0l2.500-2.500a3.540 3.540 0 0 0-5-5L9.500 5.500M12 8a3.500 3.500 0 0 0-5 0L4.500 10.500a3.540 3.540 0 0 0 5 5l1-1" /><path v-else d="M9 15.500 8.500 16a3.500 3.500 0 0 1-5-5L5 9.500M11 4.500l.5-.5a3.500 3.500 0 0 1 5 5L15 10.500M4 4l12 12" /></svg></button>
  <button v-if="field.left_out && field.given && field.open" type="button" class="lock" :title="'Leave it out: ' + field.left_out" :aria-label="'Leave out ' + field.spoken" @click="ask('write', field.symbol, '')">×</button>
  <input class="number" :id="'n-' + field.symbol" type="text" inputmode="text" autocomplete="off" spellcheck="false" :value="text" :placeholder="field.left_out" :readonly="!field.open" :title="field.why" :aria-invalid="field.fault ? 'true' : 'false'" :aria-describedby="field.fault ? 'e-' + field.symbol : null" @input="typed" @change="written" @blur="left" @keydown="keys" />
  <input class="slider" type="range" min="0" :max="field.steps" step="1" :value="place" :disabled="!field.open" :aria-label="field.spoken" :aria-valuetext="field.shown" @input="slide" @pointerdown="grasp" @pointerup="release" @change="release" />
  <p v-if="field.fault" class="fault" :id="'e-' + field.symbol" role="alert">{{ field.fault }}</p>
</div>`,
  };

  // What the scene lies in, how the objective maps it, and the window at the tip.
  const Bore = {
    props: ["bore"],
    setup(props) {
      // Both show what the server says, which may refuse.
      function medium(event) {
        ask("choose", "medium", event.target.value === "index" ? "1.35" : event.target.value);
        event.target.value = props.bore.medium;
      }
      function turn(event) {
        ask("choose", "window", event.target.checked ? "yes" : "no");
        event.target.checked = props.bore.window;
      }
      function mapping(event) {
        ask("choose", "mapping", event.target.value);
        event.target.value = props.bore.mapping;
      }
      return { ask, medium, turn, mapping };
    },
    template: `
<fieldset><legend>Bore</legend>
  <div class="field" :class="{ wrong: bore.medium_fault }" data-field="medium"><label for="n-medium">Scene lies in</label>
    <select id="n-medium" class="number" :value="bore.medium" @change="medium"><option v-for="name in bore.media" :key="name" :value="name">{{ name }}</option><option value="index">index…</option></select>
    <p v-if="bore.medium_fault" class="fault" role="alert">{{ bore.medium_fault }}</p></div>
  <div v-if="bore.medium === 'index'" class="field" data-field="medium_index"><label for="n-index"><b><i>n</i></b> Its index</label>
    <input id="n-index" class="number" type="text" autocomplete="off" :value="bore.index" @change="ask('choose', 'medium', $event.target.value)" /></div>
  <div v-if="bore.mapping" class="field" :class="{ wrong: bore.mapping_fault }" data-field="mapping"><label for="n-mapping">Objective images by</label>
    <select id="n-mapping" class="number" :value="bore.mapping" @change="mapping"><option v-for="name in bore.mappings" :key="name" :value="name">{{ name }}</option></select>
    <p v-if="bore.mapping_fault" class="fault" role="alert">{{ bore.mapping_fault }}</p></div>
  <div class="field" :class="{ wrong: bore.window_fault }" data-field="window"><label for="n-window">Window at the tip</label>
    <input id="n-window" type="checkbox" class="tick" :checked="bore.window" @change="turn" />
    <p v-if="bore.window_fault" class="fault" role="alert">{{ bore.window_fault }}</p></div>
  <template v-if="bore.window">
    <div class="field" :class="{ wrong: bore.window_material_fault }" data-field="window_material"><label for="n-material">Window material</label>
      <input id="n-material" class="number" type="text" list="glasses" autocomplete="off" spellcheck="false" :value="bore.material" :aria-invalid="bore.window_material_fault ? 'true' : 'false'" @change="ask('choose', 'window_material', $event.target.value)" />
      <datalist id="glasses"><option v-for="name in bore.materials" :key="name" :value="name"></option></datalist>
      <p v-if="bore.window_material_fault" class="fault" role="alert">{{ bore.window_material_fault }}</p></div>
    <rx-field v-for="field in bore.fields" :key="field.symbol" :field="field"></rx-field>
  </template>
</fieldset>`,
  };

  // Behind a real lens: what is drawn, or computed, for its thin-lens model all the same.
  const Twin = {
    props: ["lens", "words"],
    template: `<span v-if="lens" class="twin" :title="words === 'traced' ? 'With what rays through ' + lens + ' show.' : 'For an ideal thin lens of the same focal length and diameter, depth in temperature by the glass of ' + lens + ', which itself is traced for the verdicts above, effects, field and light at a glance, reports and tolerance runs.'">{{ words || 'thin lens' }}</span>`,
  };

  const Glance = {
    props: ["rows", "lens", "words"],
    setup() { return { due }; },
    template: `
<section class="card card-glance" :aria-busy="due('glance')" aria-label="Numbers at a glance"><div class="card-head"><h2>Numbers at a glance <rx-twin :lens="lens" :words="words"></rx-twin></h2></div>
  <div class="found"><table><caption class="unseen">Numbers at a glance</caption><tbody><tr v-for="row in rows" :key="row.label"><td v-html="row.label"></td><td>{{ row.value }}</td></tr></tbody></table></div>
</section>`,
  };

  const Card = {
    props: ["name", "label", "files", "lens", "words"],
    setup() { return { fetchFile, fetchPng }; },
    template: `
<section class="card" :class="'card-' + name" :aria-label="label">
  <div class="card-head"><h2>{{ label }} <rx-twin :lens="lens" :words="words"></rx-twin></h2><slot name="tools"></slot>
    <span v-if="files !== false" class="files"><button type="button" :aria-label="label + ' as SVG'" @click="fetchFile(name + '.svg')">SVG</button><button type="button" :aria-label="label + ' as PNG'" @click="fetchPng(name)">PNG</button></span></div>
  <slot></slot>
</section>`,
  };

  const Picture = {
    props: ["name", "svg", "drag", "click", "help"],
    setup(props) {
      const box = ref(null);
      let gesture = "";
      onMounted(() => { boxes.set(props.name, box.value); observer.observe(box.value); });
      onBeforeUnmount(() => { boxes.delete(props.name); observer.unobserve(box.value); });
      function where(event) {
        const svg = box.value.querySelector("svg");
        const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
        return [point.x, point.y];
      }
      function down(event) {
        if (event.button !== 0 || !(props.drag || props.click)) return;
        gesture = `${props.name}:${serial++}`;
        box.value.setPointerCapture(event.pointerId);
        point(event);
      }
      function move(event) { if (gesture && props.drag) point(event); }
      function point(event) { askAs(props.name, "point", props.name, ...where(event), gesture); event.preventDefault(); }
      function up() {
        if (!gesture) return;
        gesture = "";
        if (props.drag) ask("let_go");
      }
      function keys(event) {
        if (!(props.drag || props.click)) return;
        const step = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
        if (!step) return;
        const size = event.shiftKey ? 10 : 1;
        ask("nudge", props.name, step[0] * size, step[1] * size);
        event.preventDefault();
      }
      return { box, down, move, up, keys, due: computed(() => due(`picture_${props.name.replaceAll("-", "_")}`)) };
    },
    template: `<div class="picture" ref="box" :aria-busy="due" :data-picture="name" :class="{ live: drag || click }" :tabindex="drag || click ? 0 : null" :role="drag || click ? 'application' : null" :aria-label="help || null" @pointerdown="down" @pointermove="move" @pointerup="up" @pointercancel="up" @keydown="keys" v-html="svg"></div>`,
  };

  // The instrument in 3D, drawn by vtk.js here in the browser; only meshes that have changed come from the server.
  let vtk = null;
  let vue = null;

  function loadVtk() {
    vtk = vtk || new Promise((done, failed) => {
      const script = document.createElement("script");
      script.src = "/vtk/trame-vtk.js";
      script.onload = () => { vue.use(window.vue_vtk); done(); };
      script.onerror = failed;
      document.head.append(script);
    });
    return vtk;
  }

  function hasWebGl() {
    return Boolean(document.createElement("canvas").getContext("webgl2"));
  }

  const Space = {
    props: ["shown", "scene", "lens"],
    setup(props) {
      const ready = ref(false);
      const failed = ref(false);
      const meshes = shallowRef({});
      const view = ref(null);
      const box = ref(null);
      let serial = 0;
      let placed = false;
      let upright = false; // where the view is high and the instrument long, it stands in it
      async function begin() {
        if (ready.value || failed.value) return;
        if (!hasWebGl()) { failed.value = true; return; }
        await loadVtk();
        ready.value = true;
      }
      function take(scene) {
        if (!scene || !scene.serial || scene.serial === serial) return;
        if (scene.since && scene.since !== serial) { ask("space_again"); return; }
        const next = scene.since ? { ...meshes.value } : {};
        for (const [name, mesh] of Object.entries(toRaw(scene.meshes))) {
          if (mesh) next[name] = markRaw(mesh); else delete next[name];
        }
        serial = scene.serial;
        meshes.value = next;
        draw();
      }
      async function draw() {
        await nextTick();
        if (!view.value) return;
        if (!placed) { placed = true; setTimeout(home, 160); }
        // vtk.js draws by itself what has changed, after a moment's wait for more.
        setTimeout(() => requestAnimationFrame(() => box.value && box.value.dispatchEvent(new Event("drawn"))), 2);
      }
      function home() {
        if (!view.value || !props.scene) return;
        const { halfWidth, ...camera } = toRaw(props.scene.camera);
        // In this order: resetting sets the clipping range, and asking for the camera makes it known to the view.
        view.value.resetCamera();
        view.value.getCamera();
        const { width, height } = box.value.getBoundingClientRect();
        upright = height > width && halfWidth > camera.parallelScale;
        const ahead = camera.focalPoint.map((value, i) => value - camera.position[i]);
        const viewUp = upright ? unit(cross(ahead, camera.viewUp)) : camera.viewUp;
        view.value.setCamera({ ...camera, viewUp, ...whole(), parallelProjection: true, centerOfRotation: camera.focalPoint });
      }
      // Scale at which all of it is seen.
      function whole() {
        const { halfWidth, parallelScale } = toRaw(props.scene.camera);
        const { width, height } = box.value.getBoundingClientRect();
        const [along, across] = upright ? [parallelScale, halfWidth] : [halfWidth, parallelScale];
        return { parallelScale: Math.max(across, (along * height) / Math.max(width, 1)) };
      }
      const resized = new ResizeObserver(([{ contentRect }]) => {
        if (placed && view.value && contentRect.width) view.value.setCamera({ ...view.value.getCamera(), ...whole() });
      });
      watch(box, (now) => { if (now) resized.observe(now); });
      function turn(event) {
        const step = { ArrowLeft: [-10, 0], ArrowRight: [10, 0], ArrowUp: [0, 10], ArrowDown: [0, -10] }[event.key];
        if (!step || !view.value) return;
        const camera = view.value.getCamera();
        view.value.setCamera(orbited(camera, step[0] * Math.PI / 180, step[1] * Math.PI / 180));
        event.preventDefault();
      }
      function picture() {
        box.value.querySelector("canvas").toBlob((blob) => save(blob, `${title}-3d.png`), "image/png");
      }
      watch(() => props.shown, (shown) => { if (shown) begin(); }, { immediate: true });
      watch(() => props.scene, take, { immediate: true });
      watch(view, (now) => { placed = false; if (now) draw(); });
      // Colour of a mesh for the page; white where it is not there.
      function css(mesh) {
        return "rgb(" + (mesh ? mesh.colour : [1, 1, 1]).map((part) => Math.round(255 * part)).join() + ")";
      }
      // One mesh of each colour that has a name.
      function legend() {
        const named = Object.values(meshes.value).filter((mesh) => mesh.label);
        return [...new Map(named.map((mesh) => [mesh.label, mesh])).values()];
      }
      return { ready, failed, meshes, view, box, home, turn, picture, css, legend };
    },
    template: `
<section class="card card-space" aria-label="The instrument in 3D">
  <div class="card-head"><h2>The instrument in 3D <rx-twin :lens="lens"></rx-twin></h2><span v-if="meshes['rays centre']" class="hint key" data-testid="space-key"><span v-for="mesh in legend()" :key="mesh.label"><i :class="{ solid: mesh.polys.length }" :style="{ background: css(mesh), opacity: Math.min(2 * mesh.opacity, 1) }"></i>{{ mesh.label }}</span></span><span class="hint">drag to turn, wheel to zoom, middle button to move</span>
    <button type="button" @click="home" data-testid="space-home">Whole view</button><span class="files"><button type="button" aria-label="The instrument in 3D as PNG" @click="picture">PNG</button></span></div>
  <p v-if="failed" class="note">The browser gives no WebGL 2, so there is no 3D view; all else works.</p>
  <div v-else class="picture space" data-picture="space" ref="box" tabindex="0" role="application" aria-label="3D view of the instrument; the arrow keys turn it" @keydown="turn">
    <vtk-view v-if="ready && scene.serial" :key="scene.ground.join()" ref="view" :background="scene.ground" :interactor-settings="[{ button: 1, action: 'Rotate' }, { button: 2, action: 'Pan' }, { button: 3, action: 'Zoom', scrollEnabled: true }, { button: 1, action: 'Pan', shift: true }]">
      <vtk-geometry-representation v-for="(mesh, name) in meshes" :key="name" :property="{ color: mesh.colour, opacity: mesh.opacity, lineWidth: mesh.width, lighting: mesh.polys.length > 0, ambient: 0.25, diffuse: 0.75 }">
        <vtk-polydata :points="mesh.points" :lines="mesh.lines" :polys="mesh.polys"></vtk-polydata>
      </vtk-geometry-representation>
    </vtk-view>
  </div>
</section>`,
  };

  function orbited(camera, yaw, pitch) {
    const from = camera.focalPoint;
    const away = camera.position.map((value, i) => value - from[i]);
    const up = camera.viewUp;
    const turned = rotated(away, up, yaw);
    const side = unit(cross(up, turned));
    const raised = rotated(turned, side, -pitch);
    return { ...camera, position: raised.map((value, i) => value + from[i]), viewUp: rotated(up, side, -pitch) };
  }

  function cross(a, b) { return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]; }
  function unit(a) { const size = Math.hypot(...a) || 1; return a.map((value) => value / size); }

  function rotated(a, about, angle) {
    const axis = unit(about);
    const along = axis.reduce((sum, value, i) => sum + value * a[i], 0) * (1 - Math.cos(angle));
    const across = cross(axis, a);
    return a.map((value, i) => value * Math.cos(angle) + across[i] * Math.sin(angle) + axis[i] * along);
  }

  // A run in the background: start, progress, cancel.
  function startRun(kind, event) {
    const options = {};
    for (const [name, value] of new FormData(event.target)) (options[name] = options[name] || []).push(value);
    ask("start_run", kind, options);
  }

  const RunView = {
    props: ["kind", "run"],
    setup() { return { ask }; },
    template: `
<div class="go"><button type="submit" class="primary" :data-testid="'start-' + kind" :disabled="run.state === 'running'">{{ run.state === 'none' ? 'Start' : 'Start again' }}</button>
<button type="button" :data-testid="'cancel-' + kind" :disabled="run.state !== 'running'" @click="ask('cancel_run', kind)">Cancel</button><button v-if="kind === 'optimise' && run.state === 'running'" type="button" data-testid="stop-optimise" :disabled="!(run.share > 0)" title="At the end of the search under way" @click="ask('stop_run', kind)">Stop with the best so far</button><span v-if="run.seconds" class="hint">{{ run.seconds }}</span></div>
<div v-if="run.state === 'running'" class="progress" role="status"><progress max="1" :value.attr="run.share < 0 ? null : run.share" :aria-label="'Progress of the ' + kind + ' run'"></progress><span>{{ run.text }}</span></div>
<p v-if="run.message" class="fault" role="alert" :data-testid="'failed-' + kind">{{ run.message }}</p>`,
  };

  // A bound of a variable: the usual one, which follows the design, until another is typed.
  const BoundView = {
    props: ["name", "usual", "label"],
    setup() {
      const own = ref(null);
      function typed(event) { own.value = event.target.value; }
      function left() { if (own.value !== null && !own.value.trim()) own.value = null; }
      return { own, typed, left };
    },
    template: `<input type="text" spellcheck="false" autocomplete="off" :name="name" :aria-label="label" :value="own === null ? usual : own" @input="typed" @change="left" />`,
  };

  // Limits of the yield: those that the design's [required] sets, else the usual ones, and as many as are added.
  const LimitsView = {
    props: ["forms"],
    setup(props) {
      const blank = { of: "", at: "", min: "", max: "" };
      const rows = ref(props.forms.asked.length ? props.forms.asked.map(row => ({ ...row })) : [{ ...blank }]);
      return { rows, alone: ref(props.forms.asked.length > 0), add: () => rows.value.push({ ...blank }) };
    },
    template: `
<fieldset class="vary limits"><legend>A good build holds</legend><p v-if="forms.asked.length" class="hint">Limits of the design's [required] come first; change them, or add others.</p><p v-if="!alone" class="hint">{{ forms.usual }}</p>
<div v-for="(row, k) in rows" :key="k"><select name="limit_of" v-model="row.of" :aria-label="'Limited quantity ' + (k + 1)"><option value="">{{ k ? 'nothing more' : 'nothing else' }}</option><option v-for="item in forms.limited" :key="item.key" :value="item.key">{{ item.label }}</option></select>
<label>min <input type="text" name="limit_min" v-model="row.min" spellcheck="false" autocomplete="off" :aria-label="'Least ' + (k + 1)" /></label><label>max <input type="text" name="limit_max" v-model="row.max" spellcheck="false" autocomplete="off" :aria-label="'Greatest ' + (k + 1)" /></label><label>at <input type="text" name="limit_at" v-model="row.at" spellcheck="false" autocomplete="off" :aria-label="'Distance ahead of the tip ' + (k + 1)" title="Distance ahead of the tip; the focal plane, or the whole camera, where left out" /></label></div>
<button type="button" @click="add">Add a limit</button><label class="tick"><input type="checkbox" name="only_own" v-model="alone" />these alone, without the usual limits</label></fieldset>`,
  };

  const Menu = {
    props: ["label", "name"],
    template: `<details class="menu" :data-testid="'menu-' + name"><summary>{{ label }}</summary><div class="panel"><slot></slot></div></details>`,
  };

  window.roslfExplorer = {
    install(app) {
      vue = app;
      app.component("rx-shell", Shell);
      app.component("rx-field", FieldView);
      app.component("rx-bore", Bore);
      app.component("rx-card", Card);
      app.component("rx-glance", Glance);
      app.component("rx-twin", Twin);
      app.component("rx-picture", Picture);
      app.component("rx-menu", Menu);
      app.component("rx-space", Space);
      app.component("rx-run", RunView);
      app.component("rx-bound", BoundView);
      app.component("rx-limits", LimitsView);
      app.config.globalProperties.$rx = {
        view, due, showTab, ask, askAs, turnTheme, fetchFile, fetchPng, copyLink, upload, path, preset, toViews, tabKeys, turnSheet, closeMenus, startRun, say, reload: () => location.reload(),
      };
    },
  };
})();
