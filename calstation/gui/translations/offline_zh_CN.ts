<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>Comparison</name>
    <message>
        <source>unit</source>
        <extracomment>A difference of more than so many sigmas is marked.</extracomment>
        <translation>单位</translation>
    </message>
    <message>
        <source>run</source>
        <translation>在线</translation>
    </message>
    <message>
        <source>offline</source>
        <translation>离线</translation>
    </message>
    <message>
        <source>diff.</source>
        <translation>差值</translation>
    </message>
    <message>
        <source>in σ</source>
        <translation>差值/σ</translation>
    </message>
    <message>
        <source>Run</source>
        <translation>在线标定</translation>
    </message>
    <message>
        <source>Offline</source>
        <translation>离线解算</translation>
    </message>
    <message>
        <source>Difference</source>
        <translation>比较</translation>
    </message>
    <message>
        <source>Parameters and their sigmas will stand here once a range is solved.</source>
        <translation>解算完成后，这里显示各参数及其标准差。</translation>
    </message>
    <message>
        <source>The run&apos;s parameters and those solved offline</source>
        <translation>在线标定与离线解算的参数</translation>
    </message>
    <message>
        <source>No result: this run did not reach its end</source>
        <translation>没有结果：这次标定没有做完</translation>
    </message>
    <message>
        <source>The log holds no result of a run</source>
        <translation>记录中没有在线标定结果</translation>
    </message>
    <message>
        <source>Not solved yet</source>
        <translation>尚未解算</translation>
    </message>
    <message>
        <source>Solved as far as the data go; not every stage is</source>
        <translation>已按现有数据解算，并非每个阶段都能解算</translation>
    </message>
    <message>
        <source>Solved; the log names no limits to compare with</source>
        <translation>已解算；记录中没有可比较的限差</translation>
    </message>
    <message>
        <source>Inside every limit of the product</source>
        <translation>各项都在产品限差之内</translation>
    </message>
    <message>
        <source>Outside the limits: {0} of {1} checks</source>
        <translation>超出限差：{1} 项检查中有 {0} 项</translation>
    </message>
    <message>
        <source>Identical bit for bit</source>
        <translation>逐位完全一致</translation>
    </message>
    <message>
        <source>Largest difference {0} σ, {1}</source>
        <translation>最大差值 {0} σ，{1}</translation>
    </message>
    <message>
        <source>{0}; beyond 3 σ: {1}</source>
        <translation>{0}；超过 3 σ 的有 {1} 项</translation>
    </message>
    <message>
        <source>From samples {0} to {1}, part of the log.</source>
        <translation>只解算了记录的一部分：采样 {0} 至 {1}。</translation>
    </message>
    <message>
        <source>, </source>
        <translation>、</translation>
    </message>
    <message>
        <source>Stages solved: {0}.</source>
        <translation>解算的阶段：{0}。</translation>
    </message>
    <message>
        <source>Not determined by these data: {0} of {1} parameters, marked below.</source>
        <translation>{1} 个参数中有 {0} 个无法由这些数据确定，已在下表标出。</translation>
    </message>
</context>
<context>
    <name>Exports</name>
    <message>
        <source>Compressed CSV (*.csv.gz)</source>
        <translation>压缩 CSV (*.csv.gz)</translation>
    </message>
    <message>
        <source>Export the log</source>
        <translation>导出记录</translation>
    </message>
    <message>
        <source>Export the range</source>
        <translation>导出范围</translation>
    </message>
    <message>
        <source>Parameters as CSV (*.csv)</source>
        <translation>参数表 CSV (*.csv)</translation>
    </message>
    <message>
        <source>Export the result</source>
        <translation>导出结果</translation>
    </message>
</context>
<context>
    <name>LogHead</name>
    <message>
        <source>Closer (+)</source>
        <translation>放大 (+)</translation>
    </message>
    <message>
        <source>Further away (−)</source>
        <translation>缩小 (−)</translation>
    </message>
    <message>
        <source>Bring the chosen range into view</source>
        <translation>显示所选范围</translation>
    </message>
    <message>
        <source>Bring the whole log into view (Home)</source>
        <translation>显示整个记录 (Home)</translation>
    </message>
    <message>
        <source>Range</source>
        <translation>范围</translation>
    </message>
    <message>
        <source>All</source>
        <translation>全部</translation>
    </message>
    <message>
        <source>{0} samples, {1} Hz</source>
        <translation>{0} 个样本，{1} Hz</translation>
    </message>
    <message>
        <source>gaps: {0}</source>
        <translation>中断 {0} 处</translation>
    </message>
    <message>
        <source>spoilt samples: {0}</source>
        <translation>无效采样 {0} 个</translation>
    </message>
    <message>
        <source>damaged rows: {0}</source>
        <translation>损坏的数据行 {0} 行</translation>
    </message>
</context>
<context>
    <name>LogPlot</name>
    <message>
        <source>outer</source>
        <extracomment>Channels of each plot: gyro, accelerometer, angles. Width of the axes at the left, px. What the view shows beyond the log&apos;s ends, of its length: an edge there can still be taken hold of. Samples in the closest view. Room for the note at the top of a plot, px. Of the view, what an arrow key moves it.</extracomment>
        <translation>外轴</translation>
    </message>
    <message>
        <source>inner</source>
        <translation>内轴</translation>
    </message>
    <message>
        <source>Gyro, °/s</source>
        <translation>陀螺，°/s</translation>
    </message>
    <message>
        <source>Accelerometer, m/s²</source>
        <translation>加表，m/s²</translation>
    </message>
    <message>
        <source>Table, °</source>
        <translation>转台，°</translation>
    </message>
    <message>
        <source>The log&apos;s curves</source>
        <translation>记录曲线</translation>
    </message>
</context>
<context>
    <name>OfflinePage</name>
    <message>
        <source>Offline</source>
        <translation>离线解算</translation>
    </message>
    <message>
        <source>Another log can be opened when this work is done or cancelled.</source>
        <translation>等当前任务完成或取消后，才能打开另一个记录。</translation>
    </message>
    <message>
        <source>This log cannot be opened</source>
        <translation>无法打开这个记录</translation>
    </message>
    <message>
        <source>This range cannot be solved</source>
        <translation>这个范围无法解算</translation>
    </message>
    <message>
        <source>Written</source>
        <translation>已写入</translation>
    </message>
    <message>
        <source>The export failed</source>
        <translation>导出失败</translation>
    </message>
    <message>
        <source>Sample {0}</source>
        <translation>采样 {0}</translation>
    </message>
    <message>
        <source>Open a log first</source>
        <translation>请先打开一个记录</translation>
    </message>
    <message>
        <source>Wait for the work at hand, or cancel it</source>
        <translation>请等当前任务完成，或取消它</translation>
    </message>
    <message>
        <source>The range holds no stage; widen it</source>
        <translation>所选范围内没有任何阶段，请扩大范围</translation>
    </message>
    <message>
        <source>Tick a stage to solve</source>
        <translation>请勾选要解算的阶段</translation>
    </message>
    <message>
        <source>Export range…</source>
        <translation>导出范围…</translation>
    </message>
    <message>
        <source>Only the samples chosen; “Set to…” goes back to the whole log</source>
        <translation>仅所选采样；用“设为…”可恢复整个记录</translation>
    </message>
    <message>
        <source>Solve the log first</source>
        <translation>请先解算</translation>
    </message>
    <message>
        <source>A stored log, drawn and solved again</source>
        <translation>查看数据记录并离线解算</translation>
    </message>
    <message>
        <source>Open a log…</source>
        <translation>打开记录…</translation>
    </message>
    <message>
        <source>Reading the log</source>
        <translation>正在读取记录</translation>
    </message>
    <message>
        <source>Start offline solve</source>
        <translation>开始离线解算</translation>
    </message>
    <message>
        <source>Export result…</source>
        <translation>导出结果…</translation>
    </message>
    <message>
        <source>Export log…</source>
        <translation>导出记录…</translation>
    </message>
    <message>
        <source>Open a raw log (.h5) or a CSV with its TOML beside it, or drop the file here. Choose a range; the solver of the run solves it again, and both results are compared.</source>
        <translation>打开原始日志（.h5）或带同名 TOML 的 CSV，也可将文件拖到此处。选择区间后，用与运行时相同的解算程序重新解算，并比较两个结果。</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
</context>
<context>
    <name>RangeBar</name>
    <message>
        <source>First sample</source>
        <extracomment>Up to here a double, and so this box, holds every whole number.</extracomment>
        <translation>起始采样</translation>
    </message>
    <message>
        <source>Last sample</source>
        <translation>结束采样</translation>
    </message>
    <message>
        <source>Set to…</source>
        <translation>设为…</translation>
    </message>
    <message>
        <source>The whole log, or one of its stages</source>
        <translation>整个记录，或其中一个阶段</translation>
    </message>
    <message>
        <source>Whole log</source>
        <translation>整个记录</translation>
    </message>
    <message>
        <source>The first sample cannot lie behind the last: set to {0}.</source>
        <translation>起始采样不能在结束采样之后：已设为 {0}。</translation>
    </message>
    <message>
        <source>The last sample cannot lie before the first: set to {0}.</source>
        <translation>结束采样不能在起始采样之前：已设为 {0}。</translation>
    </message>
    <message>
        <source>{0} is not in this log; it holds samples {1} to {2}.</source>
        <translation>{0} 不在此记录内；记录含采样 {1} 至 {2}。</translation>
    </message>
</context>
<context>
    <name>SourceBar</name>
    <message>
        <source>Open a log</source>
        <extracomment>A path that has not changed for this long and leads to a file is opened, as one that is pasted or filled in is.</extracomment>
        <translation>打开记录</translation>
    </message>
    <message>
        <source>Logs (*.h5 *.csv *.csv.gz)</source>
        <translation>数据记录 (*.h5 *.csv *.csv.gz)</translation>
    </message>
    <message>
        <source>All files (*)</source>
        <translation>所有文件 (*)</translation>
    </message>
    <message>
        <source>Log</source>
        <translation>记录</translation>
    </message>
    <message>
        <source>Path of a raw log (.h5) or of a CSV with its TOML beside it</source>
        <translation>原始记录（.h5）的路径，或旁边有 TOML 的 CSV 的路径</translation>
    </message>
    <message>
        <source>Open…</source>
        <translation>打开…</translation>
    </message>
    <message>
        <source>Recent</source>
        <translation>最近打开</translation>
    </message>
    <message>
        <source>Latest runs</source>
        <translation>最近的标定</translation>
    </message>
    <message>
        <source>No log has been opened here yet</source>
        <translation>这里还没有打开过记录</translation>
    </message>
</context>
<context>
    <name>StageChoice</name>
    <message>
        <source>The range holds no sample of this stage</source>
        <translation>所选范围内没有这个阶段的采样</translation>
    </message>
</context>
<context>
    <name>logs</name>
    <message>
        <source>the log holds no samples; record some</source>
        <translation>记录中没有采样，请先采集</translation>
    </message>
    <message>
        <source>samples or configuration differ from what the run recorded (sha256); use an unchanged copy of the log</source>
        <translation>采样或配置与标定时写入的不一致（sha256），请使用未改动的记录副本</translation>
    </message>
    <message>
        <source>not a log; give a raw log (.h5) or a .csv(.gz) beside its .toml</source>
        <translation>不是数据记录，请选择原始记录（.h5），或旁边有 .toml 的 .csv(.gz)</translation>
    </message>
    <message>
        <source>no such file; give the path of an existing log</source>
        <translation>文件不存在，请给出已有记录的路径</translation>
    </message>
    <message>
        <source>damaged, cut short or no raw log; use a copy of the log</source>
        <translation>文件损坏、不完整或不是原始记录，请使用记录的副本</translation>
    </message>
    <message>
        <source>not a raw log of this program; give a .h5 log or a .csv</source>
        <translation>不是本程序的原始记录，请选择 .h5 记录或 .csv</translation>
    </message>
    <message>
        <source>row {0} is damaged; use a copy of the log</source>
        <translation>第 {0} 行已损坏，请使用记录的副本</translation>
    </message>
    <message>
        <source>its configuration is damaged ({0}); use a copy of the log</source>
        <translation>其中的配置已损坏（{0}），请使用记录的副本</translation>
    </message>
    <message>
        <source>is empty; give a header row and samples</source>
        <translation>文件是空的，请给出表头和采样</translation>
    </message>
    <message>
        <source>column &apos;{0}&apos; is missing; add it to the header and rows</source>
        <translation>缺少列 &apos;{0}&apos;，请在表头和各行中补上</translation>
    </message>
    <message>
        <source>column &apos;{0}&apos; is missing; is it &apos;{1}&apos;?</source>
        <translation>缺少列 &apos;{0}&apos;，是不是 &apos;{1}&apos;？</translation>
    </message>
    <message>
        <source>column &apos;{0}&apos; is there twice; remove one</source>
        <translation>列 &apos;{0}&apos; 出现了两次，请删去一个</translation>
    </message>
    <message>
        <source>line {0} has {1} cells, the header {2}; complete the row or remove it</source>
        <translation>第 {0} 行有 {1} 个单元格，表头有 {2} 个，请补全或删去这一行</translation>
    </message>
    <message>
        <source>line {0}: {1} is empty; correct the cell or remove the row</source>
        <translation>第 {0} 行：{1} 为空，请改正单元格或删去这一行</translation>
    </message>
    <message>
        <source>line {0}: {1} is NaN; correct the cell or remove the row</source>
        <translation>第 {0} 行：{1} 为 NaN，请改正单元格或删去这一行</translation>
    </message>
    <message>
        <source>line {0}: {1} is infinite; correct the cell or remove the row</source>
        <translation>第 {0} 行：{1} 为无穷大，请改正单元格或删去这一行</translation>
    </message>
    <message>
        <source>line {0}: {1} = &apos;{2}&apos; is not a number; correct the cell or remove the row</source>
        <translation>第 {0} 行：{1} = &apos;{2}&apos; 不是数字，请改正单元格或删去这一行</translation>
    </message>
    <message>
        <source>line {0}: {1} = {2} is not a whole number; correct the cell or remove the row</source>
        <translation>第 {0} 行：{1} = {2} 不是整数，请改正单元格或删去这一行</translation>
    </message>
    <message>
        <source>line {0}: the log&apos;s rows are repeated from here; remove them</source>
        <translation>从第 {0} 行起内容重复，请删去重复的行</translation>
    </message>
    <message>
        <source>line {0}: seq {1} is repeated; remove repeated rows and sort the rest as they were sampled</source>
        <translation>第 {0} 行：seq {1} 重复，请删去重复的行，其余按采样顺序排列</translation>
    </message>
    <message>
        <source>line {0}: seq falls from {1} to {2}; remove repeated rows and sort the rest as they were sampled</source>
        <translation>第 {0} 行：seq 从 {1} 降到 {2}，请删去重复的行，其余按采样顺序排列</translation>
    </message>
    <message>
        <source>line {0}: time_s falls from {1} to {2} s; remove repeated rows and sort the rest as they were sampled</source>
        <translation>第 {0} 行：time_s 从 {1} 降到 {2} s，请删去重复的行，其余按采样顺序排列</translation>
    </message>
    <message>
        <source>rows near line {0} do not fit the header; save it again</source>
        <translation>第 {0} 行附近与表头不符，请重新保存</translation>
    </message>
    <message>
        <source>time_s runs at {0} Hz but imu.sample_rate_hz = {1}; correct one of them</source>
        <translation>time_s 的频率为 {0} Hz，而 imu.sample_rate_hz = {1}，请改正其中之一</translation>
    </message>
    <message>
        <source>the compressed file is damaged or cut short; copy it again</source>
        <translation>压缩文件损坏或不完整，请重新复制</translation>
    </message>
    <message>
        <source>not UTF-8 text; save it as UTF-8</source>
        <translation>不是 UTF-8 文本，请存为 UTF-8</translation>
    </message>
    <message>
        <source>cannot be read ({0})</source>
        <translation>无法读取（{0}）</translation>
    </message>
    <message>
        <source>cannot be written ({0}); choose another folder</source>
        <translation>无法写入（{0}），请选择其他文件夹</translation>
    </message>
    <message>
        <source>the log&apos;s picture cannot be written ({0}); make room on its disk</source>
        <translation>曲线缓存无法写入（{0}），请腾出磁盘空间</translation>
    </message>
    <message>
        <source>no samples after the header; record some</source>
        <translation>表头之后没有采样，请先采集</translation>
    </message>
    <message>
        <source>no such file; give the path of an existing TOML file</source>
        <translation>文件不存在，请给出已有 TOML 文件的路径</translation>
    </message>
    <message>
        <source>an export&apos;s name ends in .csv or .csv.gz; rename the target</source>
        <translation>导出文件名应以 .csv 或 .csv.gz 结尾，请改名</translation>
    </message>
    <message>
        <source>is the log itself; choose another name</source>
        <translation>这就是记录本身，请换一个文件名</translation>
    </message>
    <message>
        <source>stage &apos;{0}&apos;: the solution diverged ({1}); check site.azimuth_deg, the axes in [table] and the sigmas in [prior]</source>
        <translation>阶段“{0}”：解算发散（{1}），请检查 site.azimuth_deg、[table] 中的轴向和 [prior] 中的标准差</translation>
    </message>
    <message>
        <source>stage &apos;{0}&apos;: no rest of at least 1 s in {1} s of samples to align on; include the rest before the first turn</source>
        <translation>阶段“{0}”：{1} s 的采样中没有至少 1 s 的静止段可供对准，请把第一次转动之前的静止段包括进来</translation>
    </message>
    <message>
        <source>stage &apos;{0}&apos;: no rest of {1} s or more with {2} upward ({3} rests found); include all six faces</source>
        <translation>阶段“{0}”：{2} 朝上时没有 {1} s 以上的静止段（共找到 {3} 个静止段），请包括全部六个面</translation>
    </message>
    <message>
        <source>stage &apos;{0}&apos;: no whole turn about {1} between two rests ({2} turns found); include both ways about every axis with the rests before and after</source>
        <translation>阶段“{0}”：两个静止段之间没有绕 {1} 的整圈转动（共找到 {2} 次转动），请包括各轴的正反转动及其前后的静止段</translation>
    </message>
    <message>
        <source>stage &apos;{0}&apos;: no whole turn about {1} between two rests ({2} turns found, {3} gaps or spoilt stretches, each of which costs its turn); include both ways about every axis with the rests before and after</source>
        <translation>阶段“{0}”：两个静止段之间没有绕 {1} 的整圈转动（共找到 {2} 次转动；{3} 处中断或无效段，各使所在的转动作废），请包括各轴的正反转动及其前后的静止段</translation>
    </message>
    <message>
        <source>no sample from {0} to {1}; the log holds {2} to {3}, choose the range in there</source>
        <extracomment>What the command line says, and what is said where there are boxes to fill in.</extracomment>
        <translation>{0} 至 {1} 之间没有采样，记录的范围是 {2} 至 {3}，请在其中选择</translation>
    </message>
    <message>
        <source>no sample in the chosen range belongs to a stage; widen the range, or name stages in the column &apos;stage&apos;</source>
        <translation>所选范围内没有属于任何阶段的采样，请扩大范围，或在 &apos;stage&apos; 列中写明阶段</translation>
    </message>
    <message>
        <source>no samples of stage &apos;{0}&apos; in the chosen range, which holds {1}; choose other stages or widen the range</source>
        <translation>所选范围内没有阶段“{0}”的采样（只有 {1}），请另选阶段或扩大范围</translation>
    </message>
    <message>
        <source>stage &apos;{0}&apos; was recorded twice; choose a range that holds it once, or leave it out</source>
        <translation>阶段“{0}”记录了两次，请选择只含一次的范围，或不解算它</translation>
    </message>
    <message>
        <source>{0} is frozen: one value all through; check its encoder</source>
        <translation>{0} 卡死：自始至终一个值；请检查其编码器</translation>
    </message>
    <message>
        <source>{0} is frozen: one value from sample {1} to {2} ({3} s); check the unit and its cable and record again</source>
        <translation>{0} 卡死：样本 {1} 至 {2}（{3} s）一直是同一个值；请检查产品和电缆后重新录取</translation>
    </message>
    <message>
        <source>{0} is frozen for {1} s from {2} s on; check the unit and its cable and record again</source>
        <translation>{0} 从 {2} s 起卡死 {1} s；请检查产品和电缆后重新录取</translation>
    </message>
    <message>
        <source>{0} is frozen from sample {1} to {2}; check the unit and its cable</source>
        <translation>{0} 在样本 {1} 至 {2} 卡死；请检查产品和电缆</translation>
    </message>
    <message>
        <source>the gyros&apos; units are wrong by a factor: their noise looks like motion, and rests appear where rates are multiplied by {0} ({1}); correct imu.gyro_lsb or imu.output</source>
        <translation>陀螺单位差一个倍数：噪声看起来像运动，角速度乘以 {0} 后才出现静止段（{1}）；请改正 imu.gyro_lsb 或 imu.output</translation>
    </message>
    <message>
        <source>no rest of {0} s or more in {1} s of samples; lay the unit still at every position</source>
        <translation>{1} s 的数据中没有 {0} s 以上的静止段；请在每个位置放稳产品</translation>
    </message>
    <message>
        <source>no rest of {0} s to check at; lay the body still once</source>
        <translation>没有 {0} s 的静止段可供检查；请让载体静止一次</translation>
    </message>
    <message>
        <source>no motion: all {0} rests lie the same way up; turn the unit to other positions between rests</source>
        <translation>没有运动：{0} 个静止段姿态都相同；请在静止之间把产品转到别的位置</translation>
    </message>
    <message>
        <source>accelerometers at rest show {0} m/s² where gravity is {1}: units wrong by a factor of {2} ({3}); correct imu.accel_lsb or imu.output</source>
        <translation>静止时加表给出 {0} m/s²，而重力为 {1}：单位差 {2} 倍（{3}）；请改正 imu.accel_lsb 或 imu.output</translation>
    </message>
    <message>
        <source>accelerometers at rest show {0} m/s² where gravity is {1}: units wrong by a factor of {2}; correct imu.accel_lsb or imu.output</source>
        <translation>静止时加表给出 {0} m/s²，而重力为 {1}：单位差 {2} 倍；请改正 imu.accel_lsb 或 imu.output</translation>
    </message>
    <message>
        <source>the gyros do not see the motions: {0}° where gravity turned by {1}° (samples {2} to {3}); check that they are alive and imu.gyro_lsb</source>
        <translation>陀螺没有感受到运动：重力方向转了 {1}°，陀螺只有 {0}°（样本 {2} 至 {3}）；请检查陀螺是否工作以及 imu.gyro_lsb</translation>
    </message>
    <message>
        <source>the gyro&apos;s axes are not the accelerometer&apos;s: motions agree with gravity where {0}; correct the columns or their signs</source>
        <translation>陀螺的轴与加表的轴不一致：当 {0} 时运动才与重力相符；请改正数据列或其符号</translation>
    </message>
    <message>
        <source>the gyros&apos; units are wrong by a factor: motions agree with gravity where rates are multiplied by {0} ({1}); correct imu.gyro_lsb or imu.output</source>
        <translation>陀螺单位差一个倍数：角速度乘以 {0} 后运动才与重力相符（{1}）；请改正 imu.gyro_lsb 或 imu.output</translation>
    </message>
    <message>
        <source>the gyros&apos; units are wrong by a factor: motions agree with gravity where rates are multiplied by {0}; correct imu.gyro_lsb or imu.output</source>
        <translation>陀螺单位差一个倍数：角速度乘以 {0} 后运动才与重力相符；请改正 imu.gyro_lsb 或 imu.output</translation>
    </message>
    <message>
        <source>gyros and accelerometers contradict each other in too many of {0} motions, most by {1}° in samples {2} to {3}; check gaps, saturation and columns</source>
        <translation>{0} 段运动中陀螺与加表互相矛盾的太多，样本 {2} 至 {3} 最甚，差 {1}°；请检查丢数、饱和与数据列</translation>
    </message>
    <message>
        <source>imu{0}: {1} s of synchronous samples with the primary; record both for {2} s or more</source>
        <translation>imu{0}：与主惯组同步的数据只有 {1} s；请同时录取 {2} s 以上</translation>
    </message>
    <message>
        <source>no motion in the recording; {0} about all axes</source>
        <translation>数据中没有运动；请绕所有轴{0}</translation>
    </message>
    <message>
        <source>hardly any motion about {0} ({1} of that about others), so nothing is determined there; {2} about {3} too</source>
        <translation>绕 {0} 轴几乎没有运动（只有其他轴的 {1}），该轴无法确定；请绕 {3} 轴也{2}</translation>
    </message>
    <message>
        <source>imu{0}: its {1} measures {2} times what the primary&apos;s does: units wrong by a factor; correct imu{3}.{4}_lsb or .output</source>
        <translation>imu{0}：其 {1} 的测量值是主惯组的 {2} 倍，单位差一个倍数；请改正 imu{3}.{4}_lsb 或 .output</translation>
    </message>
    <message>
        <source>imu{0}: the axes of its {1} are a mirror image of the primary&apos;s; two columns are swapped or one has the wrong sign</source>
        <translation>imu{0}：其 {1} 的轴系与主惯组互为镜像：有两列对调了，或有一列符号相反</translation>
    </message>
    <message>
        <source>imu{0}: its gyro and accelerometer lie {1}° apart; columns of one are swapped</source>
        <translation>imu{0}：其陀螺与加表的轴系相差 {1}°；其中之一的数据列对调了</translation>
    </message>
    <message>
        <source>imu{0}: the motion does not determine what is asked for; turn about all axes</source>
        <translation>imu{0}：这些运动不足以确定所要求的参数；请绕所有轴转动</translation>
    </message>
    <message>
        <source>cross_calibration needs a second IMU; add [imu2] to the configuration and its columns to the log</source>
        <translation>互标定需要第二个惯组；请在配置中加入 [imu2]，并在数据中加入它的列</translation>
    </message>
    <message>
        <source>holds one IMU; add [imu2] to the configuration and its columns to the log</source>
        <translation>只有一个惯组；请在配置中加入 [imu2]，并在数据中加入它的列</translation>
    </message>
    <message>
        <source>{0} s of motion where {1} are asked for</source>
        <translation>运动只有 {0} s，要求 {1} s</translation>
    </message>
    <message>
        <source>no joint angles; add the columns joint_x_deg, joint_y_deg and joint_z_deg of the gimbal</source>
        <translation>没有框架角；请加入框架的 joint_x_deg、joint_y_deg 和 joint_z_deg 三列</translation>
    </message>
    <message>
        <source>no turn of one joint from zero between rests of {0} s ({1} motions found); bring the joints to zero, rest, turn one axis, rest</source>
        <translation>在 {0} s 的静止段之间没有单轴从零位开始的转动（找到 {1} 段运动）；请把框架回零、静止、转一个轴、再静止</translation>
    </message>
    <message>
        <source>joint_{0} was turned but gyro_{1} saw it (samples {2} to {3}); axes are swapped, correct the columns</source>
        <translation>转的是 joint_{0}，感受到的却是 gyro_{1}（样本 {2} 至 {3}）：轴对调了，请改正数据列</translation>
    </message>
    <message>
        <source>gyro_{0} and joint_{1} turn opposite ways (samples {2} to {3}); correct a sign</source>
        <translation>gyro_{0} 与 joint_{1} 转向相反（样本 {2} 至 {3}）；请改正其中一个符号</translation>
    </message>
    <message>
        <source>gyro_{0} turned {1} times as far as joint_{2} (samples {3} to {4}): units wrong by a factor; correct imu.gyro_lsb or the joints&apos; columns</source>
        <translation>gyro_{0} 转过的角度是 joint_{2} 的 {1} 倍（样本 {3} 至 {4}）：单位差一个倍数；请改正 imu.gyro_lsb 或框架角的列</translation>
    </message>
    <message>
        <source>turned about {0} the joints drift by {1}″ after {2} turns and drifted by {3}″ at first: the rates were not corrected by K; correct them, or the schedule&apos;s gain and order</source>
        <translation>绕 {0} 轴转 {2} 次后其余框架仍漂移 {1}″，最初为 {3}″：角速度没有用 K 修正；请加以修正，或改正方案的增益和框架次序</translation>
    </message>
    <message>
        <source>g instead of m/s²</source>
        <translation>用了 g 而不是 m/s²</translation>
    </message>
    <message>
        <source>mg instead of m/s²</source>
        <translation>用了 mg 而不是 m/s²</translation>
    </message>
    <message>
        <source>m/s² instead of g</source>
        <translation>用了 m/s² 而不是 g</translation>
    </message>
    <message>
        <source>mm/s² instead of m/s²</source>
        <translation>用了 mm/s² 而不是 m/s²</translation>
    </message>
    <message>
        <source>°/s instead of rad/s</source>
        <translation>用了 °/s 而不是 rad/s</translation>
    </message>
    <message>
        <source>rad/s instead of °/s</source>
        <translation>用了 rad/s 而不是 °/s</translation>
    </message>
    <message>
        <source>mrad/s instead of rad/s</source>
        <translation>用了 mrad/s 而不是 rad/s</translation>
    </message>
    <message>
        <source>m°/s instead of rad/s</source>
        <translation>用了 m°/s 而不是 rad/s</translation>
    </message>
    <message>
        <source>turn the body</source>
        <translation>转动载体</translation>
    </message>
    <message>
        <source>tilt or shake the body</source>
        <translation>倾斜或晃动载体</translation>
    </message>
    <message>
        <source>gyro_{0} is {1}gyro_{2}</source>
        <translation>gyro_{0} 取 {1}gyro_{2}</translation>
    </message>
    <message>
        <source> and </source>
        <translation>、</translation>
    </message>
</context>
</TS>
