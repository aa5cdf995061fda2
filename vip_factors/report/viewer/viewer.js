// The one script of both pages: a report has its motion in it, the live page waits for answers.
import { showLive } from "./live.js";
import { showReport } from "./report.js";
import { find } from "./stage.js";

if (find("motion")) showReport();
else showLive();
