// The page's interface by hand: what guests see and may do, by keyboard and touch, and whether axe-core
// finds barriers. Nothing of the gateway or of the picture runs here.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { after, before, test } from "node:test";

import { bundle, findings, launch, open, serve } from "./interface_harness.mjs";

let server;
let browser;
before(async () => {
  server = await serve();
  browser = await launch();
});
after(async () => {
  await browser?.close();
  server?.close();
});

// Runs with a page of its own and fails if a script or the policy complained.
function pageTest(name, options, run) {
  test(name, { timeout: 120_000 }, async () => {
    const page = await open(browser, server.url, options);
    try {
      await run(page);
      assert.deepEqual(page.problems, []);
    } finally {
      await page.close();
    }
  });
}

const text = (page, selector) => page.$eval(selector, (element) => element.textContent);
const until = (page, condition, ...values) => page.waitForFunction(condition, { polling: 50 }, ...values);

async function pure(file) {
  const script = await bundle(`export * from "./src/ui/${file}";`, "esm");
  return import(`data:text/javascript;base64,${Buffer.from(script).toString("base64")}`);
}

const kScenes = {
  login: () => {},
  live: () => {
    harness.connect({ mayFeel: ["isovalue", "stiffness_n_per_mm", "friction", "method"] });
    Object.assign(harness.state.view, { veil: -300, slices: true });
    harness.copy.groupsLeft = 5;
    harness.state.emit("copyProgress");
    harness.stream();
  },
  lost: () => {
    harness.connect();
    harness.fillHistory();
    Object.assign(harness.state, { link: "lost", linkWhy: "no answer" });
    harness.state.emit("link");
    harness.state.tell("the gateway did not answer for 10 s");
  },
  "no WebGL2": () => {
    harness.connect();
    harness.fillHistory();
    harness.state.whyNoPicture = "This browser has no WebGL2.";
    harness.state.emit("picture");
  },
};
pageTest("layers are listed with the band that the proxy is in, and nobody steers the isovalue then", {}, async (page) => {
  await page.evaluate(() => {
    harness.connect({ mayFeel: ["isovalue"] });
    harness.fact("settings", { settingsRevision: 2, settings: { isovalue: 320, layers: { layer: [
      { id: 2, name: "skin", isovalue: -300 }, { id: 1, name: "bone", isovalue: 300 }] } } });
    harness.pose(1, { layersPassed: 1, contactLayer: 0, freeSide: 2 });
  });
  const layers = await page.$$eval(".layers li", (lines) => lines.map((line) => line.textContent));
  assert.deepEqual(layers, ["skin −300 HU", "bone 300 HU"]);
  const { left, width } = await page.$eval(".band", (band) => ({ left: band.style.left, width: band.style.width }));
  assert.deepEqual([left, width], ["35%", "30%"]);
  assert.ok(await page.$eval('[data-mark="isovalue"]', (mark) => mark.hidden));
  await page.$eval(".suggestions button", (button) => button.click());
  assert.deepEqual(await page.evaluate(() => [harness.state.view.veil, harness.calls]), [-300, []]);
});

for (const [scene, prepare] of Object.entries(kScenes)) {
  for (const [width, height, isMobile] of [[360, 740, true], [1440, 900, false]]) {
    pageTest(`axe-core has no serious finding: ${scene}, ${width} pixels`, { width, height, isMobile }, async (page) => {
      await page.evaluate(prepare);
      for (const theme of ["dark", "light"]) {
        await page.evaluate((shown) => {
          harness.state.view.theme = shown;
          harness.state.emit("view");
          const panel = document.getElementById("panel");
          if (panel.hidden && !document.querySelector("dialog[open]")) document.getElementById("panel-toggle").click();
        }, theme);
        await until(page, (shown) => document.documentElement.dataset.theme === shown, theme);
        assert.deepEqual(await findings(page), [], theme);
      }
    });
  }
}

pageTest("the help has no serious finding, keeps the focus, and Esc leaves it", {}, async (page) => {
  await page.evaluate(() => harness.connect());
  await page.focus("#viewport");
  await page.keyboard.press("?");
  assert.deepEqual(await findings(page), []);
  for (let n = 0; n < 5; ++n) {
    await page.keyboard.press("Tab");
    // Beyond the dialog's last element browsers offer their own bar; the page behind is inert.
    assert.ok(await page.evaluate(() => document.activeElement === document.body || document.activeElement.closest("dialog") !== null));
  }
  await page.keyboard.press("Escape");
  await until(page, () => !document.querySelector("dialog[open]") && document.activeElement.id === "viewport");
});

pageTest("login by keyboard: a refusal in words, then the room", {}, async (page) => {
  await until(page, () => document.activeElement?.id === "login-secret");
  await page.evaluate(() => (harness.room.refusal = "wrong key"));
  await page.keyboard.type("first");
  await page.keyboard.press("Enter");
  await until(page, () => document.getElementById("login-error").textContent.includes("Ask your host"));
  await page.keyboard.press("Escape");
  assert.ok(await page.$eval("#login", (dialog) => dialog.open));
  await page.evaluate(() => (harness.room.refusal = ""));
  await page.keyboard.type("second"); // replaces the first, which is selected
  await page.keyboard.press("Enter");
  await until(page, () => !document.getElementById("login").open);
  assert.deepEqual(await page.evaluate(() => harness.calls), [
    { what: "login", secret: { room: "first" } },
    { what: "login", secret: { room: "second" } },
  ]);
  assert.equal(await page.$eval("#login-secret", (input) => input.value), "");
});

pageTest("the login stays, however often Escape is pressed", {}, async (page) => {
  await until(page, () => document.getElementById("login").open);
  await page.evaluate(() => document.getElementById("login").addEventListener("close", () => (window.wasClosed = true)));
  for (let n = 0; n < 5; ++n) await page.keyboard.press("Escape");
  await until(page, () => window.wasClosed);
  await until(page, () => document.getElementById("login").open && document.activeElement.id === "login-secret");
});

pageTest("a link with a wrong key leads to the login, with an error", {}, async (page) => {
  await page.evaluate(() => {
    harness.connect();
    Object.assign(harness.state, { link: "login", linkWhy: "wrong key" });
    harness.state.emit("link");
  });
  await until(page, () => document.getElementById("login").open);
  assert.match(await text(page, "#login-error"), /Ask your host/);
});

test("a refused key leaves the address, and what else is there stays", { timeout: 120_000 }, async () => {
  const page = await browser.newPage();
  await page.goto(`${server.url}whole/#room=OLD&view=1,2,3,4,5,6`);
  await until(page, () => document.getElementById("login").open);
  await until(page, () => location.hash === "#view=1,2,3,4,5,6");
  await page.close();
});

pageTest("a personal token goes as a token", {}, async (page) => {
  await until(page, () => document.getElementById("login").open);
  await page.click("#login-by-token");
  await page.type("#login-secret", "mine");
  await page.keyboard.press("Enter");
  await until(page, () => harness.calls.length === 1);
  assert.deepEqual(await page.evaluate(() => harness.calls[0].secret), { token: "mine" });
});

pageTest("the veil by keyboard", {}, async (page) => {
  await page.evaluate(() => harness.connect());
  await page.focus("#viewport");
  await page.keyboard.press("v");
  assert.equal(await page.evaluate(() => harness.state.view.veil), -300); // the suggestion below the isovalue
  await page.focus(".mark[data-mark=veil]");
  const press = async (key) => {
    await page.keyboard.press(key);
    return page.$eval(":focus", (handle) => [handle.type, handle.value, handle.ariaValueText]);
  };
  assert.deepEqual(await press("ArrowRight"), ["range", "-299", "−299 HU"]);
  assert.deepEqual(await press("ArrowLeft"), ["range", "-300", "−300 HU"]);
  assert.deepEqual(await press("PageUp"), ["range", "-100", "−100 HU"]);
  assert.deepEqual(await press("End"), ["range", "1000", "1000 HU"]);
  assert.deepEqual(await press("Home"), ["range", "-1000", "−1000 HU"]);
  assert.equal(await page.evaluate(() => harness.state.view.veil), -1000);
  assert.deepEqual(await page.evaluate(() => harness.calls), []); // nobody else is disturbed
  await page.keyboard.press("v");
  assert.equal(await page.evaluate(() => harness.state.view.veil), null);
});

pageTest("suggestions say why, and take the veil there", {}, async (page) => {
  await page.evaluate(() => harness.connect());
  assert.match(await page.$eval(".suggestions", (element) => element.innerText), /between air and soft tissue/);
  await page.click(".suggestions button");
  assert.equal(await page.evaluate(() => harness.state.view.veil), -300);
});

pageTest("guests see the isovalue and who set it, and cannot move it", {}, async (page) => {
  await page.evaluate(() => harness.connect());
  assert.match(await text(page, "#isovalue"), /320 HU.*lecturer-1/s);
  assert.ok(await page.$eval(".mark[data-mark=isovalue]", (handle) => handle.hidden));
  assert.ok(await page.$eval("#steer-section", (section) => section.hidden));
  assert.ok(await page.$eval("#isovalue input[type=number]", (input) => input.hidden));
  const box = await page.$eval(".histogram", (element) => element.getBoundingClientRect().toJSON());
  await page.mouse.move(box.x + 0.66 * box.width, box.y + 40); // on the isovalue
  await page.mouse.down();
  await page.mouse.move(box.x + 0.3 * box.width, box.y + 40);
  await page.mouse.up();
  assert.deepEqual(await page.evaluate(() => harness.calls), []);
});

pageTest("a dragged isovalue is sent at most 8 times a second, and the newest arrives", {}, async (page) => {
  await page.evaluate(() => harness.connect({ mayFeel: ["isovalue"] }));
  const handle = await page.$eval(".mark[data-mark=isovalue]", (element) => element.getBoundingClientRect().toJSON());
  const x = handle.x + 17 + 0.66 * (handle.width - 34); // half of a thumb from the ends
  await page.mouse.move(x, handle.y + 40);
  await page.mouse.down();
  for (let n = 1; n <= 60; ++n) await page.mouse.move(x - 2 * n, handle.y + 40);
  const shown = Number(await page.$eval(".mark[data-mark=isovalue]", (element) => element.value));
  await page.mouse.up();
  await until(page, (value) => harness.calls.at(-1)?.value === value, shown);
  const calls = await page.evaluate(() => harness.calls);
  assert.ok(shown < 320 && calls.every(({ key }) => key === "isovalue"));
  calls.slice(1).forEach(({ atMs }, n) => assert.ok(atMs - calls[n].atMs >= 124));
});

pageTest("all hear who steers, once for a drag, and not what was before they came", {}, async (page) => {
  const steered = (...changes) => page.evaluate((list) => {
    harness.receive("steering", { changes: list.map(([user, key, time_ms]) => ({ user, key, value: 1, time_ms })) });
    return harness.state.events;
  }, changes);
  await page.evaluate(() => harness.connect());
  const drag = [["ann", "friction", 90_000], ["ann", "isovalue", 100_000]];
  assert.deepEqual(await steered(...drag), ["Isovalue set by ann"]);
  assert.equal((await steered(...drag, ["ann", "isovalue", 100_125])).length, 1);
  assert.equal((await steered(...drag)).length, 1); // again, as after a new connection
  assert.deepEqual(await steered(["bob", "isovalue", 100_500]), ["Isovalue set by ann", "Isovalue set by bob"]);
  await until(page, () => document.querySelector("#events li").textContent.endsWith("Isovalue set by bob"));
});

pageTest("where there is no clipboard, the link is shown", {}, async (page) => {
  await page.evaluate(() => {
    harness.connect();
    Object.defineProperty(navigator, "clipboard", { value: undefined });
  });
  const shown = new Promise((resume) => page.once("dialog", (dialog) => dialog.accept().then(() => resume(dialog.defaultValue()))));
  await page.click("#share");
  assert.match(await shown, /#room=KEY/);
});

pageTest("everybody can stop the forces, at the press, and hears what came of it", {}, async (page) => {
  const isShown = () => page.$eval("#stop", (button) => !button.hidden);
  assert.ok(!(await isShown()));
  await page.evaluate(() => harness.connect({ mayStop: false }));
  assert.ok(!(await isShown()));
  await page.evaluate(() => harness.connect());
  assert.ok(await isShown());
  const stops = () => page.evaluate(() => harness.calls.filter(({ key }) => key === "stop").length);
  const button = await (await page.$("#stop")).boundingBox();
  await page.mouse.move(button.x + 5, button.y + 5);
  await page.mouse.down();
  await until(page, () => document.getElementById("stop-result").textContent === "forces stopped");
  assert.equal(await stops(), 1);
  await page.mouse.up();
  assert.equal(await stops(), 1);
  await page.evaluate(() => (harness.room.refusal = "palpated is not reached"));
  await page.focus("#stop");
  await page.keyboard.press("Enter");
  await until(page, () => document.getElementById("stop-result").textContent.includes("palpated is not reached"));
  assert.equal(await stops(), 2);
  assert.equal(await page.$eval("#stop-result", (result) => result.dataset.tone), "alarm");
  await page.evaluate(() => harness.receive("steering", { changes: [{ user: "ann", key: "stop", value: 0, time_ms: 1 }] }));
  await until(page, () => harness.state.events.some((event) => event === "Forces stopped by ann"));
});

pageTest("controls by the kind of the setting; a refusal is said beside", {}, async (page) => {
  await page.evaluate(() => harness.connect({ mayFeel: ["stiffness_n_per_mm", "friction", "method"] }));
  await page.select("#steer-method", "0");
  await page.click("#steer input[type=checkbox]");
  await page.evaluate(() => (harness.room.refusal = "not now"));
  await page.$eval("#steer-stiffness_n_per_mm", (input) => {
    input.value = "1.25";
    input.dispatchEvent(new Event("change"));
  });
  await until(page, () => document.getElementById("steer").textContent.includes("not now"));
  assert.deepEqual((await page.evaluate(() => harness.calls)).map(({ key, value }) => [key, value]), [
    ["method", 0], ["friction", 0], ["stiffness_n_per_mm", 1.25],
  ]);
  // palpated's value is back.
  await until(page, () => document.getElementById("steer-stiffness_n_per_mm").value === "0.6");
});

pageTest("an isovalue that palpated refused does not stay in the field", {}, async (page) => {
  await page.evaluate(() => {
    harness.connect({ mayFeel: ["isovalue"] });
    harness.room.refusal = "beyond the volume's range";
  });
  const field = "#isovalue input[type=number]";
  await page.click(field, { count: 3 });
  await page.keyboard.type("99999");
  await page.keyboard.press("Enter");
  await until(page, () => document.querySelector("#isovalue .error").textContent !== "");
  await page.focus("#viewport");
  assert.equal(await page.$eval(field, (input) => input.value), "320");
});

pageTest("text from outside stays text", {}, async (page) => {
  const script = '<img src=x onerror="window.hacked = 1"><script>window.hacked = 1</script>';
  await page.evaluate((name) => {
    harness.connect({ name });
    harness.receive("connection", { state: "lost", why: name, palpated: name, since_ms: 0 });
    harness.receive("steering", { changes: [{ user: name, key: "isovalue", value: 1, time_ms: 0 }] });
    const volume = { ...harness.state.volume, unit: name, suggestedIsovalues: [{ name, isovalue: 1, reason: name }] };
    harness.fact("volume", volume);
    harness.state.tell(name);
    harness.state.whyNoPicture = name;
    harness.state.emit("picture");
  }, script);
  await until(page, (name) => document.getElementById("badge-words").textContent.includes(name), script);
  for (const selector of ["#volume-name", "#events", "#isovalue", "#server", "#no-picture-why"]) {
    assert.ok((await text(page, selector)).includes(script), selector);
  }
  assert.equal(await page.$("img"), null);
  assert.equal(await page.evaluate(() => window.hacked), undefined);
});

pageTest("the badge says in words how old the stream is, and is announced once", {}, async (page) => {
  const says = (words) => until(page, (pattern) => new RegExp(pattern).test(document.getElementById("badge-words").textContent), words);
  await page.evaluate(() => {
    harness.connect();
    window.announced = [];
    const announcement = document.getElementById("announcement");
    new MutationObserver(() => announced.push(announcement.textContent)).observe(announcement, { childList: true, characterData: true, subtree: true });
    harness.stream();
  });
  await says("^live$");
  await until(page, () => announced.includes("live"));
  await page.evaluate(() => harness.pause());
  await says("^([2-9]|\\d\\d+)\\.\\d s old$");
  assert.match(await text(page, "#mode"), /last known/);
  assert.deepEqual(await page.evaluate(() => announced.slice(announced.indexOf("live") + 1)), ["the stream is old"]);
  await page.evaluate(() => harness.receive("connection", { state: "lost", why: "palpated is not reached", palpated: "", since_ms: 0 }));
  await says("^palpated is not reached$");
  await page.evaluate(() => harness.receive("connection", { state: "lost", why: "nobody publishes this room", palpated: "", since_ms: 0 }));
  await says("^nobody publishes this room$");
  await page.evaluate(() => {
    harness.state.link = "lost";
    harness.state.emit("link");
  });
  await says("^connection lost, trying again$");
});

pageTest("a replay is no live picture, and says what is with the forces", {}, async (page) => {
  const badgeSays = (words) => until(page, (is) => document.getElementById("badge-words").textContent === is, words);
  // What is said of the forces, once the badge has these words.
  const shown = async (words, changed) => {
    await page.evaluate((members) => {
      clearInterval(window.replaying);
      const pose = () => harness.pose(performance.now() / 1000, members);
      pose();
      window.replaying = setInterval(pose, 16);
    }, changed);
    await badgeSays(words);
    assert.equal(await page.$("#stage[data-replay]") !== null, changed.replayed ?? false);
    return text(page, "#mode");
  };
  await page.evaluate(() => harness.connect());
  await shown("live", {});
  const words = "replay: forces are off";
  let mode = await shown(words, { replayed: true, forces: { state: 4, reason: 13, limitN: 0 } });
  assert.match(mode, /replay: forces are off until/);
  assert.doesNotMatch(mode, /last known/);
  await page.evaluate(() => clearInterval(window.replaying));
  await until(page, () => document.getElementById("badge-words").textContent.endsWith("old"));
  assert.equal(await page.$("#stage[data-replay]"), null);
  await shown("live", {});
  mode = await shown(words, { replayed: true, forces: { state: 6, reason: 11, limitN: 0 } });
  assert.match(mode, /replay: forces are off; .*emergency stop/);
});

pageTest("in a replay the settings are the recorded ones, and nobody sets them", {}, async (page) => {
  await page.evaluate(() => harness.connect({ mayFeel: ["isovalue", "stiffness_n_per_mm"] }));
  const setters = () => page.evaluate(() => [
    document.querySelector("#isovalue input[type=number]").hidden, document.getElementById("steer").inert,
  ]);
  assert.deepEqual(await setters(), [false, false]);
  const settings = { isovalue: 111, stiffnessNPerMm: 0.2 };
  await page.evaluate((replayed) => harness.fact("settings", replayed), { settingsRevision: 9, replayed: true, settings });
  assert.deepEqual(await setters(), [true, true]);
  assert.match(await text(page, "#isovalue"), /111 HU *of the replay/);
  assert.match(await text(page, "#steer-section"), /the replay's/);
  assert.equal(await page.$eval("#steer-stiffness_n_per_mm", (input) => input.value), "0.2");
  await page.evaluate(() => harness.fact("settings", { settingsRevision: 10, replayed: false, settings: { isovalue: 320, stiffnessNPerMm: 0.6 } }));
  assert.deepEqual(await setters(), [false, false]);
});

pageTest("the progress of the volume, and why there is the overview alone", {}, async (page) => {
  const says = (pattern) => until(page, (p) => new RegExp(p).test(document.getElementById("progress-words").textContent), pattern);
  await page.evaluate(() => {
    harness.connect();
    const nowMs = performance.now();
    performance.now = () => nowMs; // however slow the machine is
    Object.assign(harness.copy, { isOverview: true, groupsAll: 4096, groupsLeft: 2896, groupBytes: 65536, fetching: { sinceMs: nowMs - 9_990, groups: 4096 } });
    harness.state.emit("copyProgress");
  });
  await says("^overview; 75 MiB of 256 MiB, 29 %, about 25 s left$");
  assert.equal(await page.$eval("#progress-bar", (bar) => bar.value), 1200 / 4096);
  await page.evaluate(() => {
    Object.assign(harness.copy, { factor: 4, groupsLeft: 0, whyOverview: "1 GiB is more than this page holds" });
    harness.state.emit("copyProgress");
  });
  await says("4 × 4 × 4 voxels.*1 GiB is more");
  await page.evaluate(() => {
    Object.assign(harness.copy, { factor: 1, isOverview: false, whyOverview: "" });
    harness.state.emit("copyProgress");
  });
  await until(page, () => document.getElementById("progress").hidden);
});

pageTest("without WebGL2 slices are drawn and moved by keys", {}, async (page) => {
  await page.evaluate(() => {
    harness.connect();
    harness.pose(0);
    harness.state.whyNoPicture = "no WebGL2";
    harness.state.emit("picture");
  });
  const slider = "#slices-planes figure:first-child input";
  const isAt = (voxel) => until(page, (at) =>
    document.querySelector("#slices-planes figure:first-child input").getAttribute("aria-valuetext") === `voxel ${at} of 47`, voxel);
  await isAt(24); // in the middle, whatever the proxy does
  await page.click("#slices-follow");
  await isAt(19);
  const brightest = () => page.$eval("#slices-planes canvas", (canvas) => {
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    return data.reduce((most, value, at) => (at % 4 === 2 ? Math.max(most, value) : most), 0);
  });
  assert.ok(await brightest() > 150);
  await page.focus(slider);
  await page.keyboard.press("Home");
  await until(page, () => document.querySelector("#slices-planes canvas").ariaLabel.includes("voxel 0 of 47"));
  assert.ok(!(await page.$eval("#slices-follow", (box) => box.checked)));
});

pageTest("the first Tab leads to the panels, and the link of the room stays", { width: 360, isMobile: true }, async (page) => {
  await page.evaluate(() => {
    harness.connect();
    document.activeElement.blur();
    history.replaceState(null, "", "#room=KEY");
  });
  await until(page, () => !document.querySelector("dialog[open]"));
  await page.keyboard.press("Tab");
  await page.keyboard.press("Enter");
  assert.deepEqual(await page.evaluate(() => [document.activeElement.id, document.activeElement.hidden, location.hash]), ["panel", false, "#room=KEY"]);
});

pageTest("Shift and an arrow move the camera along the picture", {}, async (page) => {
  await page.evaluate(() => {
    harness.connect();
    // From the front: anterior is +z, superior is up.
    Object.assign(harness.state.view, { azimuthDeg: 0, elevationDeg: 0, target: [0, 0, 0], follow: true });
  });
  await page.focus("#viewport");
  await page.keyboard.down("Shift");
  for (const key of ["ArrowRight", "ArrowUp", "ArrowUp"]) await page.keyboard.press(key);
  await page.keyboard.up("Shift");
  const { target: [x, y, z], azimuthDeg, elevationDeg, follow } = await page.evaluate(() => harness.state.view);
  assert.ok(x > 1 && Math.abs(y) < 1e-9 && Math.abs(z - 2 * x) < 1e-9, `${[x, y, z]}`);
  assert.deepEqual([azimuthDeg, elevationDeg, follow], [0, 0, false]);
});

pageTest("keys of the picture turn and zoom it; letters can be switched off", {}, async (page) => {
  await page.evaluate(() => harness.connect());
  await page.focus("#viewport");
  const view = () => page.evaluate(() => ({ ...harness.state.view }));
  const first = await view();
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("ArrowUp");
  await page.keyboard.press("+");
  await page.keyboard.press("f");
  await page.keyboard.press("r");
  const second = await view();
  assert.ok(second.azimuthDeg > first.azimuthDeg && second.elevationDeg > first.elevationDeg && second.distanceMm < first.distanceMm);
  assert.ok(second.follow);
  assert.deepEqual(await page.evaluate(() => harness.calls), [{ what: "reset" }]);
  await page.$eval("#keys-on", (box) => (box.checked = false));
  await page.keyboard.press("f");
  assert.ok((await view()).follow);
});

for (const [width, height] of [[320, 568], [844, 390], [3840, 2160]]) {
  pageTest(`nothing is wider than ${width} pixels, and targets are at least ${width < 1000 ? 44 : 32} high`, { width, height, isMobile: width < 1000 }, async (page) => {
    await page.evaluate(() => {
      harness.connect({ mayFeel: ["isovalue", "stiffness_n_per_mm", "friction", "method"], name: "a_very_long_name_".repeat(12) });
      Object.assign(harness.state.view, { slices: true, veil: 0 });
      harness.state.emit("view");
      if (document.getElementById("panel").hidden) document.getElementById("panel-toggle").click();
    });
    const wide = await page.$$eval("body *", (elements) => elements
      .filter((element) => element.checkVisibility() && !element.closest("#slices-planes *, .unseen, .tools span, svg"))
      .filter((element) => element.getBoundingClientRect().right > document.documentElement.clientWidth + 0.5)
      .map((element) => element.outerHTML.slice(0, 80)));
    assert.deepEqual(wide, []);
    const small = await page.$$eval("button, summary, select, input, label.check", (targets, least) => targets
      .filter((target) => target.checkVisibility() && !target.closest("label.check:not(:scope)") && target.type !== "checkbox" && target.type !== "radio")
      .map((target) => [target.outerHTML.slice(0, 80), target.getBoundingClientRect().toJSON()])
      .filter(([, { width: w, height: h }]) => w < least || h < least), (width < 1000 ? 44 : 32) - 0.01);
    assert.deepEqual(small, []);
    if (width > 1000) return;
    const low = await page.evaluate(() => [...document.querySelectorAll("dialog")].flatMap((dialog) => {
      dialog.showModal();
      const parts = [...dialog.querySelectorAll("button, select, input:not([type=checkbox], [type=radio])")];
      const found = parts.filter((part) => part.checkVisibility() && part.getBoundingClientRect().height < 43.99);
      dialog.close();
      return found.map(({ outerHTML }) => outerHTML);
    }));
    assert.deepEqual(low, []);
  });
}

// What the page says is judged by the array and the map alone: voxels of 0.7 x 1.5 x 2.5 mm, turned about z and x.
const kOblique = (() => {
  const [a, b] = [0.4, 0.3];
  const turned = [[Math.cos(a), Math.sin(a), 0], [-Math.sin(a) * Math.cos(b), Math.cos(a) * Math.cos(b), Math.sin(b)],
    [Math.sin(a) * Math.sin(b), -Math.cos(a) * Math.sin(b), Math.cos(b)]];
  const edges = [0.7, 1.5, 2.5];
  return { axes: turned, edges, map: [0, 1, 2].flatMap((row) => [...turned.map((axis, n) => axis[row] * edges[n]), 10 * row - 5]) };
})();

pageTest("over a slice the pointer tells value and place, and the scale bar is as long as it says", {}, async (page) => {
  await page.evaluate((map) => {
    harness.connect();
    Object.assign(harness.state.volume, { worldFromIndex: map });
    Object.assign(harness.state.placement, { deviceFromIndex: map });
    harness.state.emit("placement");
    harness.state.view.slices = true;
    harness.state.emit("view");
  }, kOblique.map);
  const [i, j, k] = kOblique.axes;
  for (const n of [1, 2, 3]) {
    const slice = `#slices-planes figure:nth-child(${n})`;
    await until(page, (selector) => document.querySelector(`${selector} canvas`).dataset.scaleBar, slice);
    const told = async (right) => {
      const { x, y, width, height } = await page.$eval(`${slice} canvas`, (canvas) => canvas.getBoundingClientRect().toJSON());
      const isHidden = (wanted) => until(page, (selector, is) => document.querySelector(selector).hidden === is, `${slice} .readout`, wanted);
      await page.mouse.move(x + width / 2, y - 10);
      await isHidden(true);
      await page.mouse.move(x + width / 2 + right, y + height / 2);
      await isHidden(false);
      const words = (await page.$eval(`${slice} .readout`, (output) => output.textContent)).match(/^(\S+) HU\n([LR]) (\S+) ([PA]) (\S+) ([SI]) (\S+) mm$/);
      const place = [2, 4, 6].map((at) => Number(words[at + 1]) * ("RAI".includes(words[at]) ? -1 : 1));
      return { value: Number(words[1].replace("−", "-")), place };
    };
    const [mm, px] = (await page.$eval(`${slice} canvas`, (canvas) => canvas.dataset.scaleBar)).split(" ").map(Number);
    const points = [await told(-20), await told(20)];
    for (const { value, place } of points) {
      const from = place.map((at, row) => at - (10 * row - 5));
      const voxel = [i, j, k].map((axis, at) => axis.reduce((sum, of, row) => sum + of * from[row], 0) / kOblique.edges[at]);
      const expected = 1000 - 40 * Math.hypot(voxel[0] - 30, voxel[1] - 28, voxel[2] - 24);
      // The place has one decimal: 0.05 mm is 40 times 0.07 voxels.
      assert.ok(Math.abs(value - expected) < 9, `${n}: ${value} is not ${expected}`);
    }
    const away = Math.hypot(...points[0].place.map((at, row) => at - points[1].place[row]));
    assert.ok(Math.abs(away - (40 * mm) / px) < 0.2, `${n}: ${away} mm are not 40 of ${px} pixels of ${mm} mm`);
  }
});

pageTest("keys 1 to 6 look from the patient's sides", {}, async (page) => {
  // Voxels along L, P and S.
  await page.evaluate(() => {
    harness.connect();
    document.activeElement.blur();
  });
  const { Camera, uprightPatient } = await import(`data:text/javascript;base64,${Buffer.from(
    await bundle('export * from "./src/view/camera";', "esm")).toString("base64")}`);
  const map = [1, 0, 0, -32, 0, 1, 0, -28, 0, 0, 1, -24];
  const sides = [[0, -1, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]];
  const ups = [[0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, 1], [0, -1, 0], [0, -1, 0]];
  for (let n = 0; n < 6; ++n) {
    await page.keyboard.press(String(n + 1));
    const { target, azimuthDeg, elevationDeg, distanceMm } = await page.evaluate(() => harness.state.view);
    const camera = new Camera();
    camera.upright = uprightPatient(map, map);
    camera.set(target, azimuthDeg, elevationDeg, distanceMm);
    const [, up, back] = camera.axes();
    const alike = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    assert.ok(alike(back, sides[n]) > 0.99 && alike(up, ups[n]) > 0.99, `${n + 1}: from ${back}, up ${up}`);
  }
});

pageTest("the cube has the patient's letters, and a click looks from there", {}, async (page) => {
  await page.evaluate(() => {
    harness.connect();
    Object.assign(harness.state.view, { azimuthDeg: 20, elevationDeg: 10 });
    harness.state.emit("view");
  });
  const letters = () => page.$$eval("#cube g:not([hidden]) text", (texts) => texts.map(({ textContent }) => textContent).sort().join(""));
  const seen = (wanted) => until(page, (is) => [...document.querySelectorAll("#cube g:not([hidden]) text")]
    .map(({ textContent }) => textContent).sort().join("") === is, wanted);
  await seen("ALS");
  const place = await page.$$eval("#cube g:not([hidden])", (groups) => groups.find((group) => group.textContent === "L").getBoundingClientRect().toJSON());
  await page.mouse.click(place.x + place.width * 0.6, place.y + place.height / 2);
  await seen("L");
  assert.deepEqual(await page.evaluate(() => [harness.state.view.azimuthDeg, harness.state.view.elevationDeg]), [90, 0]);
  // Of what is no patient, the axes of the world.
  await page.evaluate(() => harness.connect({ axes: "", name: "builtin:bumps" }));
  await seen("+x");
  assert.equal(await letters(), "+x");
});

pageTest("a link shows the isovalue of its maker as the veil, for this guest alone", {}, async (page) => {
  await page.evaluate(() => {
    Object.assign(harness.state, { linkIsovalue: -300, linkVolume: "head_ct_256.nrrd" });
    harness.state.view.cross = [1, 2, 3];
    harness.connect({ mayFeel: ["isovalue"] });
  });
  assert.equal(await page.evaluate(() => harness.state.view.veil), -300);
  assert.match(await text(page, "#message"), /−300 HU.*320 HU/);
  assert.deepEqual(await page.evaluate(() => harness.state.view.cross), [1, 2, 3]);
  assert.deepEqual(await page.evaluate(() => harness.calls), []);
  // What is of a volume says nothing of another one.
  await page.evaluate(() => {
    harness.state.setView({ veil: null });
    Object.assign(harness.state, { linkIsovalue: -300 });
    harness.fact("volume", { ...harness.state.volume, name: "other" });
  });
  assert.deepEqual(await page.evaluate(() => [harness.state.view.veil, harness.state.view.cross]), [null, null]);
});

pageTest("window and level by choice and by a finger; two fingers come closer", { isMobile: true, width: 390, height: 844 }, async (page) => {
  await page.evaluate(() => {
    harness.connect();
    harness.fact("volume", { ...harness.state.volume, name: "other", windowLevel: 700, windowWidth: 2600 });
    harness.state.view.slices = true;
    harness.state.emit("view");
  });
  const slice = "#slices-planes figure:first-child canvas";
  const chosen = (is) => until(page, (wanted) => document.getElementById("slices-window").selectedOptions[0]?.text === wanted, is);
  await chosen("As in the file");
  await page.select("#slices-window", "Lung");
  await chosen("Lung");
  await page.tap("#slices-drag");
  const { x, y, width, height } = await page.$eval(slice, (canvas) => {
    canvas.scrollIntoView();
    return canvas.getBoundingClientRect().toJSON();
  });
  const [middleX, middleY] = [x + width / 2, y + height / 2];
  const finger = await page.touchscreen.touchStart(middleX, middleY);
  await finger.move(middleX + 20, middleY);
  await until(page, () => /^Level −600, width (1[6-9]|[2-9]\d)\d\d/.test(document.getElementById("slices-window").selectedOptions[0].text));
  const other = await page.touchscreen.touchStart(middleX - 20, middleY);
  const [mm, px] = (await page.$eval(slice, (canvas) => canvas.dataset.scaleBar)).split(" ").map(Number);
  await other.move(middleX - 60, middleY);
  await until(page, (selector, before) => {
    const [barMm, barPx] = document.querySelector(selector).dataset.scaleBar.split(" ").map(Number);
    return Math.abs(barPx / barMm / before - 2) < 1e-6;
  }, slice, px / mm);
  // Of two fingers none moves the cross-hair, also when one has left; the next one alone does.
  await page.$eval("#slices-drag", (box) => (box.checked = false));
  const cross = () => page.evaluate(() => JSON.stringify(harness.state.view.cross));
  await other.end();
  await finger.move(middleX + 10, middleY + 30);
  await finger.end();
  const before = await cross();
  const [first, second] = [await page.touchscreen.touchStart(middleX, middleY), await page.touchscreen.touchStart(middleX + 30, middleY)];
  const touched = await cross();
  assert.notEqual(touched, before);
  await second.move(middleX + 60, middleY + 20);
  await second.end();
  await first.move(middleX - 30, middleY + 30);
  await first.end();
  assert.equal(await cross(), touched);
});

pageTest("a wheel before the volume is there does nothing, parts of its steps add up, and a double click moves nothing", {}, async (page) => {
  await page.evaluate(() => harness.state.setView({ slices: true, cross: [10, 11, 12] }));
  const canvas = await page.evaluateHandle(() => document.querySelector("#slices-planes canvas"));
  const wheel = (deltaY, ctrlKey) => canvas.evaluate((element, given) => element.dispatchEvent(new WheelEvent("wheel", given)), { deltaY, ctrlKey });
  await wheel(-100, false);
  await wheel(-100, true);
  await page.evaluate(() => harness.connect());
  const isAt = (voxel) => until(page, (at) =>
    document.querySelector("#slices-planes input").getAttribute("aria-valuetext") === `voxel ${at} of 47`, voxel);
  await isAt(12);
  for (let n = 0; n < 30; ++n) await wheel(-4, false); // as a trackpad
  await isAt(13);
  const { x, y, width, height } = await canvas.evaluate((element) => element.getBoundingClientRect().toJSON());
  const before = await page.evaluate(() => JSON.stringify(harness.state.view.cross));
  await page.mouse.click(x + width / 3, y + height / 3, { count: 2 });
  await until(page, (cross) => JSON.stringify(harness.state.view.cross) === cross, before);
});

pageTest("wheel and drags on a slice do what they do in the desktop viewer", {}, async (page) => {
  await page.evaluate(() => {
    harness.connect();
    harness.state.view.slices = true;
    harness.state.emit("view");
  });
  const slice = "#slices-planes figure:first-child";
  const place = () => page.$eval(`${slice} input`, (input) => input.getAttribute("aria-valuetext"));
  await until(page, (selector) => document.querySelector(`${selector} canvas`).dataset.scaleBar, slice);
  const { x, y, width, height } = await page.$eval(`${slice} canvas`, (canvas) => canvas.getBoundingClientRect().toJSON());
  const [middleX, middleY] = [x + width / 2, y + height / 2];
  await page.mouse.move(middleX, middleY);
  await page.mouse.wheel({ deltaY: -100 });
  await until(page, (selector) => document.querySelector(selector).getAttribute("aria-valuetext") === "voxel 25 of 47", `${slice} input`);
  const bar = () => page.$eval(`${slice} canvas`, (canvas) => Number(canvas.dataset.scaleBar.split(" ")[1]) / Number(canvas.dataset.scaleBar.split(" ")[0]));
  const pxPerMm = await bar();
  await page.keyboard.down("Control");
  await page.mouse.wheel({ deltaY: -100 });
  await page.keyboard.up("Control");
  await until(page, (selector, before) => {
    const [mm, px] = document.querySelector(selector).dataset.scaleBar.split(" ").map(Number);
    return Math.abs(px / mm / before - 1.2) < 1e-6;
  }, `${slice} canvas`, pxPerMm);
  const corner = () => page.$eval(`${slice} canvas`, (canvas) => canvas.getContext("2d").getImageData(canvas.width / 2 + 20, canvas.height / 2 + 20, 1, 1).data[0]);
  const gray = await corner();
  await page.mouse.down({ button: "right" });
  await page.mouse.move(middleX, middleY - 30, { steps: 3 });
  await page.mouse.up({ button: "right" });
  // A higher level is darker, and the cross-hair stays.
  await until(page, (selector, before) => {
    const canvas = document.querySelector(selector);
    return canvas.getContext("2d").getImageData(canvas.width / 2 + 20, canvas.height / 2 + 20, 1, 1).data[0] < before;
  }, `${slice} canvas`, gray);
  assert.equal(await place(), "voxel 25 of 47");
});

test("slices of a patient lie as radiologists see them, whatever the order of the voxels", async () => {
  const { sectionsOf } = await pure("sections");
  // Voxels from inferior to superior, from left to right, from anterior to posterior.
  const fromIndex = [0, -0.5, 0, 90, 0, 0, 0.7, -20, 2, 0, 0, 5];
  const [axial, coronal, sagittal] = sectionsOf({ isKnown: true, fromIndex });
  const axis = (number, sign) => ({ axis: number, sign });
  assert.deepEqual(axial, {
    name: "axial", across: axis(0, 1), right: axis(1, -1), down: axis(2, 1), labels: { right: "L", left: "R", down: "P", up: "A" },
  });
  assert.deepEqual([coronal.across, coronal.right, coronal.down], [axis(2, 1), axis(1, -1), axis(0, -1)]);
  assert.deepEqual([sagittal.across, sagittal.right, sagittal.down], [axis(1, -1), axis(2, 1), axis(0, -1)]);
  // The same planes and directions, without the patient's words.
  const unknown = sectionsOf({ isKnown: false, fromIndex });
  assert.deepEqual(unknown[0], { ...axial, name: "across z", labels: { right: "+x", left: "−x", down: "+y", up: "−y" } });
  assert.deepEqual(unknown.map(({ name }) => name), ["across z", "across y", "across x"]);
});

pageTest("where the patient faces is asked once, of who may answer", {}, async (page) => {
  const line = () => page.$eval("#facing", ({ hidden, textContent }) => (hidden ? "" : textContent));
  const told = (options) => page.evaluate((given) => harness.connect(given), options).then(line);
  assert.equal(await told({}), "");
  assert.equal(await told({ axes: "", name: "builtin:bumps" }), "");
  const question = await told({ axes: "" });
  assert.notEqual(question, "");
  // A guest reads who can answer.
  await page.click("#facing");
  assert.equal(await page.$eval("#facing-fields", (fields) => fields.checkVisibility()), false);
  await page.keyboard.press("Escape");
  await told({ axes: "", mayFeel: ["facing"] });
  await page.click("#facing");
  assert.deepEqual(await findings(page), []);
  const chosen = async (face, head) => {
    await page.select("#facing-face", face);
    await page.select("#facing-head", head);
    return page.$eval("#facing-keep", (keep) => !keep.disabled);
  };
  assert.equal(await chosen("3", ""), false);
  assert.equal(await chosen("3", "2"), false); // one axis
  assert.equal(await chosen("3", "4"), true);
  await page.evaluate(() => (harness.room.refusal = "not now"));
  await page.click("#facing-keep");
  await until(page, () => document.getElementById("facing-error").textContent === "not now");
  await page.evaluate(() => (harness.room.refusal = ""));
  await page.click("#facing-keep");
  await until(page, () => !document.getElementById("facing-dialog").open);
  assert.deepEqual(await page.evaluate(() => harness.calls.map(({ key, value }) => [key, value])), [["facing", 22], ["facing", 22]]);
  const answered = await told({ axes: "LPS", answered: true });
  assert.ok(answered !== "" && answered !== question);
});

// Pixels as an ImageData has them, in node.
const pixelsOf = (width, height) => ({ width, height, data: new Uint8ClampedArray(4 * width * height) });

test("a slice's picture is turned and mirrored as its section says", async () => {
  const { paintSlice } = await pure("slice_picture");
  const plane = { width: 3, height: 2, values: Float32Array.of(0, 10, 20, 100, 110, 120) }; // i and j
  const frame = { begin: [1, 0], scale: [1, 1] };
  const shows = (right, down, rows) => {
    const [width, height] = [rows[0].length + 2, rows.length]; // a column outside on both sides
    const pixels = pixelsOf(width, height);
    paintSlice(pixels, plane, { right, down }, frame, { level: 127.5, width: 255 }, []);
    const gray = (x, y) => (pixels.data[4 * (y * width + x) + 3] === 255 ? pixels.data[4 * (y * width + x)] : null);
    assert.deepEqual(rows.map((_, y) => Array.from({ length: width }, (__, x) => gray(x, y))), rows.map((row) => [null, ...row, null]));
  };
  const [i, j, inverseI, inverseJ] = [[0, 1], [1, 1], [0, -1], [1, -1]].map(([axis, sign]) => ({ axis, sign }));
  shows(i, j, [[0, 10, 20], [100, 110, 120]]);
  shows(inverseI, j, [[20, 10, 0], [120, 110, 100]]);
  shows(i, inverseJ, [[100, 110, 120], [0, 10, 20]]);
  shows(j, i, [[0, 100], [10, 110], [20, 120]]);
  shows(inverseJ, inverseI, [[120, 20], [110, 10], [100, 0]]);
});

test("a level's line is where the interpolated value is the level", async () => {
  const { paintSlice } = await pure("slice_picture");
  const plane = { width: 4, height: 2, values: Float32Array.of(0, 10, 20, 30, 0, 10, 20, 30) };
  const section = { right: { axis: 0, sign: 1 }, down: { axis: 1, sign: 1 } };
  const pixels = pixelsOf(32, 16);
  paintSlice(pixels, plane, section, { begin: [0, 0], scale: [8, 8] }, { level: 150, width: 300 }, [{ value: 15, color: [0, 0, 255] }]);
  // 15 is half way between voxels 1 and 2, whose middles are at 12 and 20.
  const blue = Array.from({ length: 32 }, (_, x) => pixels.data[4 * (5 * 32 + x) + 2] - pixels.data[4 * (5 * 32 + x)]);
  assert.deepEqual(blue.flatMap((value, x) => (value > 0 ? [x] : [])), [15, 16]);
  assert.ok(blue[15] > 100 && Math.abs(blue[15] - blue[16]) <= 10, String(blue));
});

test("window and page call the directions of a volume the same", async () => {
  const { sectionsOf } = await pure("sections");
  const { faceLabels, patientFrame } = await import(`data:text/javascript;base64,${Buffer.from(
    await bundle('export * from "./src/view/patient_axes";', "esm")).toString("base64")}`);
  const lines = (await readFile(new URL("patient_letters.txt", import.meta.url), "utf8")).split("\n").filter((line) => /^[^#]/.test(line));
  assert.equal(lines.length, 10);
  for (const line of lines) {
    const words = line.split(/\s+/);
    const worldFromIndex = [0, 1, 2].flatMap((row) => [...[0, 3, 6].map((column) => Number(words[column + row])), 0]);
    const frame = patientFrame({ worldFromIndex }, { patientAxes: "LPS" });
    const slices = sectionsOf(frame).flatMap(({ labels: { left, right, up, down } }) => [left, right, up, down]);
    assert.deepEqual([...faceLabels(frame).map(({ label }) => label), ...slices], words.slice(9), line);
  }
});

test("there are no lines where no value is on the other side of the isovalue", async () => {
  const { paintSlice } = await pure("slice_picture");
  const plane = { width: 8, height: 8, values: new Float32Array(64).fill(-1000) };
  const section = { right: { axis: 0, sign: 1 }, down: { axis: 1, sign: 1 } };
  for (const value of [-1000, -1000 + 1e-4, -1001, 1000 + 1e-4]) {
    if (Math.abs(value) > 1000) plane.values[0] = 1000; // values beside it are steep
    const pixels = pixelsOf(64, 64);
    paintSlice(pixels, plane, section, { begin: [0, 0], scale: [8, 8] }, { level: 0, width: 100 }, [{ value, color: [0, 0, 255] }]);
    assert.ok(pixels.data.every((part, at) => at % 4 !== 2 || part === pixels.data[at - 1]), String(value));
  }
});
